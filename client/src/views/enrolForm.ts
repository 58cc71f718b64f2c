/** Name and clip: a file that is chosen or dropped, or a turn in front of the camera. */

import type { Clip } from "../enrol";
import { announce, h } from "./dom";
import { icon } from "./icons";
import { recorder } from "./recorder";
import { button, type View } from "./shell";

const ACCEPTED = "video/*,.mp4,.mov,.webm,.mkv,.avi,.zip,.json";
const NAME_KEY = "metanerf.name";

export function enrolForm(onEnrol: (name: string, clip: Clip) => void): View {
  let clip: Clip | null = null;
  let film: View | null = null;

  const name = h("input", {
    id: "enrol-name",
    testId: "enrol-name",
    className: "field",
    type: "text",
    maxLength: 80,
    autocomplete: "name",
    placeholder: "The name others will see",
    value: localStorage.getItem(NAME_KEY) ?? "",
  });
  const file = h("input", {
    testId: "enrol-file",
    type: "file",
    accept: ACCEPTED,
    className: "unseen",
    attributes: { "aria-label": "Choose a clip" },
  });
  const chosen = h("p", { className: "chosen" });
  const complaint = h("p", { className: "complaint", attributes: { role: "alert" } });
  const drop = h(
    "label",
    { className: "drop" },
    file,
    icon("upload"),
    h("strong", {}, "Choose a clip, or drop it here"),
    h("span", { className: "soft" }, "MP4, MOV or WebM; or a ZIP of pictures"),
    chosen,
  );
  const body = h("div", { className: "enrol-body" }, drop);
  const go = button("Make my likeness", () => undefined, {
    look: "primary",
    large: true,
    testId: "enrol-submit",
    submit: true,
  });

  const take = (next: Clip | null, words: string): void => {
    clip = next;
    chosen.textContent = words;
    drop.classList.toggle("full", next !== null);
    complaint.textContent = "";
    if (words) announce(words);
  };
  file.addEventListener("change", () => {
    const [picked] = file.files ?? [];
    if (picked) take({ blob: picked, fileName: picked.name }, described(picked));
  });
  dropping(drop, (dropped) => take({ blob: dropped, fileName: dropped.name }, described(dropped)));

  const tabs = switcher(["Upload a clip", "Use the camera"], (index) => {
    film?.close();
    film = null;
    file.value = "";
    take(null, "");
    if (index === 0) {
      body.replaceChildren(drop);
    } else {
      film = recorder((recorded) => take(recorded, recorded ? "Your clip is ready" : ""));
      body.replaceChildren(film.element);
    }
  });

  const element = h(
    "form",
    { className: "card", noValidate: true },
    tabs,
    body,
    h("label", { className: "label", htmlFor: "enrol-name" }, "Your name"),
    name,
    complaint,
    go,
    h("p", { className: "soft small" }, "The clip goes to this server only. It takes about a minute."),
  );
  element.addEventListener("submit", (event) => {
    event.preventDefault();
    const called = name.value.trim();
    if (!clip) {
      complaint.textContent = film ? "Film yourself first." : "Choose a clip first.";
      file.focus();
    } else if (called === "") {
      complaint.textContent = "Tell us your name.";
      name.focus();
    } else {
      localStorage.setItem(NAME_KEY, called);
      onEnrol(called, clip);
    }
  });
  return { element, close: () => film?.close() };
}

function described(file: File): string {
  const megabytes = file.size / 1e6;
  const size = megabytes < 1 ? "under 1 MB" : `${megabytes.toFixed(0)} MB`;
  return `${file.name}, ${size}`;
}

function dropping(area: HTMLElement, onFile: (file: File) => void): void {
  const over = (event: DragEvent): void => {
    event.preventDefault();
    area.classList.add("over");
  };
  area.addEventListener("dragenter", over);
  area.addEventListener("dragover", over);
  area.addEventListener("dragleave", () => area.classList.remove("over"));
  area.addEventListener("drop", (event) => {
    event.preventDefault();
    area.classList.remove("over");
    const [file] = event.dataTransfer?.files ?? [];
    if (file) onFile(file);
  });
}

/** Two or more choices of which one holds. */
function switcher(labels: readonly string[], onChoice: (index: number) => void): HTMLElement {
  const choices = labels.map((label, index) =>
    h("button", {
      type: "button",
      textContent: label,
      onclick: () => choose(index),
      attributes: { "aria-pressed": String(index === 0) },
    }),
  );
  const choose = (index: number): void => {
    choices.forEach((choice, i) => choice.setAttribute("aria-pressed", String(i === index)));
    onChoice(index);
  };
  const attributes = { role: "group", "aria-label": "Where the clip comes from" };
  return h("div", { className: "switcher", attributes }, ...choices);
}
