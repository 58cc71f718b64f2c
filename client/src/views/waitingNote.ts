/** What one waits for while there is no picture. */

import type { LiveState } from "../live";
import { announce, h } from "./dom";

type Waiting = Exclude<LiveState, { kind: "live" | "refused" }>;

export function waitingNote(state: Waiting): HTMLElement {
  const [words, detail] = inWords(state);
  announce(words);
  return h(
    "div",
    { className: "waiting-note glass", testId: "waiting" },
    h("span", { className: "spinner", attributes: { "aria-hidden": "true" } }),
    h("div", {}, h("strong", {}, words), detail !== "" && h("p", {}, detail)),
  );
}

function inWords(state: Waiting): [words: string, detail: string] {
  switch (state.kind) {
    case "connecting":
      return ["Connecting", ""];
    case "preparing":
      return state.firstStart
        ? ["The server is starting up", "The first time on a machine this takes up to a minute; then it is quick."]
        : ["Getting the picture ready", ""];
    case "reconnecting":
      return ["Connection lost. Reconnecting", state.problem?.detail ?? ""];
  }
}
