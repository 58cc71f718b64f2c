/** A place to choose a file or drop one. */

import { announce, h } from "./dom";
import { icon } from "./icons";

interface FileDropOptions {
  title: string;
  kinds: string;
  /** For the file dialogue: types and endings. */
  accept: string;
  label: string;
  testId: string;
  onFile(file: File): void;
}

export interface FileDrop {
  element: HTMLElement;
  /** Show what was chosen; empty: nothing is. */
  say(words: string): void;
  clear(): void;
  focus(): void;
}

export function fileDrop(options: FileDropOptions): FileDrop {
  const input = h("input", {
    testId: options.testId,
    type: "file",
    accept: options.accept,
    className: "visually-hidden",
    attributes: { "aria-label": options.label },
  });
  const chosen = h("p", { className: "chosen" });
  const element = h(
    "label",
    { className: "drop" },
    input,
    icon("upload"),
    h("strong", {}, options.title),
    h("span", { className: "secondary" }, options.kinds),
    chosen,
  );
  input.addEventListener("change", () => {
    const [picked] = input.files ?? [];
    if (picked) options.onFile(picked);
  });
  dropping(element, options.onFile);
  const say = (words: string): void => {
    chosen.textContent = words;
    element.classList.toggle("has-file", words !== "");
    if (words) announce(words);
  };
  return {
    element,
    say,
    clear: () => {
      input.value = "";
      say("");
    },
    focus: () => input.focus(),
  };
}

export function described(file: File): string {
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
