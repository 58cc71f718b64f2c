/** Captions: what the others' pages write of what they speak, and one's own speech written for them. */

import type { Attendance } from "../meeting/attendance";
import { Dictation, recognitionOf } from "../meeting/dictation";
import { myself } from "../meeting/state";
import { h } from "./dom";
import type { Panel } from "./peoplePanel";

const SHOWN_MS = 6000;

export interface Captions extends Panel {
  /** The line on the stage. */
  line: HTMLElement;
  close(): void;
}

export function captions(attendance: Attendance, complain: (words: string) => void): Captions {
  const make = recognitionOf();
  const line = h("p", { className: "captions", hidden: true, testId: "caption", attributes: { "aria-live": "polite" } });
  let seen = attendance.state.caption?.number ?? 0;
  let fading: ReturnType<typeof setTimeout> | undefined;
  const dictation =
    make &&
    new Dictation(
      make,
      (text) => attendance.wish({ type: "caption", text }),
      () => {
        own.box.checked = false;
        complain("Your browser does not write down what you say. Allow it to use the microphone, or try another browser.");
      },
    );
  const shown = switchLine("captions-show", "Show captions", "", () => {
    if (!shown.box.checked) line.hidden = true;
  });
  const own = switchLine(
    "captions-own",
    "Write down what I say",
    "For the others to read. Your browser may send your voice to its maker for this.",
    () => update(),
  );
  own.element.hidden = dictation === null;
  const show = (): void => {
    const { caption } = attendance.state;
    if (!caption || caption.number <= seen) return;
    seen = caption.number;
    if (!shown.box.checked) return;
    line.replaceChildren(h("strong", {}, caption.name), ` ${caption.text}`);
    line.hidden = false;
    clearTimeout(fading);
    fading = setTimeout(() => (line.hidden = true), SHOWN_MS);
  };
  const update = (): void => {
    show();
    // what the microphone does not send is not written either
    dictation?.listen(own.box.checked && myself(attendance.state)?.microphone === true);
  };
  return {
    line,
    element: h("div", {}, h("h3", {}, "Captions"), shown.element, own.element),
    update,
    close: () => {
      clearTimeout(fading);
      dictation?.listen(false);
    },
  };
}

function switchLine(id: string, words: string, more: string, onChange: () => void): { element: HTMLElement; box: HTMLInputElement } {
  const box = h("input", { type: "checkbox", id, testId: id, attributes: { role: "switch" } });
  box.addEventListener("change", onChange);
  const label = h("label", { attributes: { for: id } }, words, more !== "" && h("small", { className: "soft" }, more));
  return { element: h("div", { className: "switch-line" }, label, box), box };
}
