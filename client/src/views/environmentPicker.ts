/** The environment of the meeting: the host chooses, the others see which it is. */

import type { Api } from "../api/api";
import type { MeetingSession } from "../meeting/session";
import { isHost } from "../meeting/state";
import { asProblem } from "../api/problem";
import type { Environment } from "../api/types";
import { h } from "./dom";
import { icon } from "./icons";
import type { Panel } from "./peoplePanel";

const OWN_PREFIX = "own-";

export function environmentPicker(api: Api, session: MeetingSession, complain: (words: string) => void): Panel {
  const { id } = session.meeting;
  const told = h("p", { className: "secondary small" });
  const choices = h("div", { className: "environment-options" });
  const set = h("fieldset", { className: "environment-picker", testId: "environments" }, h("legend", {}, "Environment"), choices);
  const element = h("div", {}, set, told);
  let environments: readonly Environment[] = [];
  let requested = false;

  const change = async (doing: (token: string) => Promise<Environment>): Promise<void> => {
    set.disabled = true;
    try {
      await doing((await session.getSeat()).token);
    } catch (error) {
      const { title, detail } = asProblem(error);
      complain(detail === "" ? title : `${title}. ${detail}`);
    }
    set.disabled = false;
    show();
  };
  const upload = panoramaInput((file) => void change((token) => api.uploadPanorama(id, file, token)));
  const show = (): void => {
    const { environment } = session.state;
    const own = environment.startsWith(OWN_PREFIX);
    const title = own ? "Custom panorama" : (environments.find(({ name }) => name === environment)?.title ?? "");
    told.textContent = isHost(session.state) || title === "" ? "" : `Environment: ${title}. Only the host can change it.`;
    for (const box of choices.querySelectorAll("input")) {
      if (box.type === "radio") box.checked = box.value === environment;
    }
    upload.classList.toggle("chosen-environment", own);
  };
  const load = async (): Promise<void> => {
    requested = true;
    try {
      environments = await api.environments();
    } catch {
      requested = false; // asked again when the panel is next opened
      return;
    }
    const choose = (name: string) => (): void => void change((token) => api.setEnvironment(id, name, token));
    choices.replaceChildren(...environments.map((place) => option(place, choose(place.name))), upload);
    show();
  };
  return {
    element,
    update: () => {
      set.hidden = !isHost(session.state);
      if (!requested && session.admitted) void load();
      show();
    },
  };
}

function option({ name, title, picture_url }: Environment, onChoice: () => void): HTMLElement {
  const box = h("input", { type: "radio", name: "environment", value: name, testId: `environment-${name}` });
  box.addEventListener("change", onChoice);
  const look = picture_url === null ? h("span", { className: "environment-plain" }) : h("img", { src: picture_url, alt: "" });
  return h("label", { className: "environment-option" }, box, look, h("span", {}, title));
}

/** A panorama from this device. */
function panoramaInput(onFile: (file: File) => void): HTMLElement {
  const box = h("input", { type: "file", className: "visually-hidden", accept: "image/jpeg,image/png", testId: "environment-file" });
  box.addEventListener("change", () => {
    const file = box.files?.[0];
    if (file) onFile(file);
    box.value = "";
  });
  const look = h("span", { className: "environment-plain" }, icon("upload"));
  return h("label", { className: "environment-option", title: "A 360° panorama, twice as wide as high" }, box, look, h("span", {}, "Upload a panorama…"));
}
