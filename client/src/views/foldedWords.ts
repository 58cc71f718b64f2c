/** An explanation that is open where there is room for it, and whatever takes its place for a while. */

import { h, isNarrow } from "./dom";

export interface FoldedWords {
  element: HTMLElement;
  /** The explanation, folded in a narrow window. */
  explain(): void;
  /** What has happened meanwhile, which nobody has to unfold. */
  say(text: string): void;
}

export function foldedWords(id: string, title: string, explanation: string): FoldedWords {
  const words = h("p", { className: "look-words", id, testId: id });
  const element = h("details", { className: "folded-words" }, h("summary", {}, title), words);
  const explain = (): void => {
    words.textContent = explanation;
    element.open = !isNarrow();
  };
  explain();
  return {
    element,
    explain,
    say: (text) => {
      words.textContent = text;
      element.open = true;
    },
  };
}
