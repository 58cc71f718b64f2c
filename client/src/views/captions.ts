/** Captions: what the others' pages write of what they speak, and one's own speech written for them. */

import type { MeetingSession } from "../meeting/session";
import { Dictation, recognitionOf } from "../meeting/dictation";
import { localParticipant } from "../meeting/state";
import { h } from "./dom";
import type { Panel } from "./peoplePanel";

const SHOWN_MS = 6000;

export interface Captions extends Panel {
  /** The line on the viewport. */
  line: HTMLElement;
  close(): void;
}

export function captions(session: MeetingSession, complain: (words: string) => void): Captions {
  const make = recognitionOf();
  const line = h("p", { className: "captions", hidden: true, testId: "caption", attributes: { "aria-live": "polite" } });
  let seen = session.state.caption?.number ?? 0;
  let fading: ReturnType<typeof setTimeout> | undefined;
  const dictation =
    make &&
    new Dictation(
      make,
      (text) => session.send({ type: "caption", text }),
      () => {
        own.box.checked = false;
        complain("Speech recognition is not available. Allow the browser to use the microphone, or try another browser.");
      },
    );
  const shown = switchLine("captions-show", "Show captions", "", () => {
    if (!shown.box.checked) line.hidden = true;
  });
  const own = switchLine(
    "captions-own",
    "Caption my speech",
    "Others can read what you say. Your browser may send your voice to its vendor for this.",
    () => update(),
  );
  own.element.hidden = dictation === null;
  const show = (): void => {
    const { caption } = session.state;
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
    dictation?.listen(own.box.checked && localParticipant(session.state)?.microphone === true);
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
  const label = h("label", { attributes: { for: id } }, words, more !== "" && h("small", { className: "secondary" }, more));
  return { element: h("div", { className: "switch-row" }, label, box), box };
}
