/** Where the meeting is held: the host chooses, the others are told. */

import type { Api } from "../api/api";
import type { Attendance } from "../meeting/attendance";
import { isHost } from "../meeting/state";
import { asProblem } from "../api/problem";
import type { Environment } from "../api/types";
import { h } from "./dom";
import { icon } from "./icons";
import type { Panel } from "./peoplePanel";

const OWN = "own-";

export function placeChoice(api: Api, attendance: Attendance, complain: (words: string) => void): Panel {
  const { id } = attendance.meeting;
  const told = h("p", { className: "soft small" });
  const choices = h("div", { className: "places" });
  const set = h("fieldset", { className: "place-choice", testId: "places" }, h("legend", {}, "Place"), choices);
  const element = h("div", {}, set, told);
  let places: readonly Environment[] = [];
  let asked = false;

  const ask = async (doing: (token: string) => Promise<Environment>): Promise<void> => {
    set.disabled = true;
    try {
      await doing((await attendance.getSeat()).token);
    } catch (error) {
      const { title, detail } = asProblem(error);
      complain(detail === "" ? title : `${title}. ${detail}`);
    }
    set.disabled = false;
    show();
  };
  const upload = ownPlace((file) => void ask((token) => api.bringPlace(id, file, token)));
  const show = (): void => {
    const { environment } = attendance.state;
    const own = environment.startsWith(OWN);
    const title = own ? "Our own" : (places.find(({ name }) => name === environment)?.title ?? "");
    told.textContent = isHost(attendance.state) || title === "" ? "" : `Place: ${title}. The host chooses it.`;
    for (const box of choices.querySelectorAll("input")) {
      if (box.type === "radio") box.checked = box.value === environment;
    }
    upload.classList.toggle("chosen-place", own);
  };
  const load = async (): Promise<void> => {
    asked = true;
    try {
      places = await api.places();
    } catch {
      asked = false; // asked again when the panel is next opened
      return;
    }
    const choose = (name: string) => (): void => void ask((token) => api.choosePlace(id, name, token));
    choices.replaceChildren(...places.map((place) => option(place, choose(place.name))), upload);
    show();
  };
  return {
    element,
    update: () => {
      set.hidden = !isHost(attendance.state);
      if (!asked && attendance.admitted) void load();
      show();
    },
  };
}

function option({ name, title, picture_url }: Environment, onChoice: () => void): HTMLElement {
  const box = h("input", { type: "radio", name: "place", value: name, testId: `place-${name}` });
  box.addEventListener("change", onChoice);
  const look = picture_url === null ? h("span", { className: "place-plain" }) : h("img", { src: picture_url, alt: "" });
  return h("label", { className: "place" }, box, look, h("span", {}, title));
}

/** A panorama from this device. */
function ownPlace(onFile: (file: File) => void): HTMLElement {
  const box = h("input", { type: "file", className: "unseen", accept: "image/jpeg,image/png", testId: "place-file" });
  box.addEventListener("change", () => {
    const file = box.files?.[0];
    if (file) onFile(file);
    box.value = "";
  });
  const look = h("span", { className: "place-plain" }, icon("upload"));
  return h("label", { className: "place", title: "A panorama all round, twice as wide as high" }, box, look, h("span", {}, "Our own…"));
}
