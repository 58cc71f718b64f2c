/** What one waits for while there is no picture, and that there is sound alone. */

import type { LiveState } from "../drawing/live";
import { announce, h } from "./dom";
import { icon } from "./icons";

const COME_BACK = "Pictures come back by themselves as soon as they get through.";

type Waiting = Exclude<LiveState, { kind: "live" | "refused" }>;

/** `inside` the meeting one hears the others; before it one only looks. */
export function waitingNote(state: Waiting, inside: boolean): HTMLElement {
  const [words, detail] = inWords(state, inside);
  announce(words);
  const sound = state.kind === "sound";
  return h(
    "div",
    { className: "waiting-note glass", testId: sound ? "sound-alone" : "waiting" },
    sound ? icon("sound") : h("span", { className: "spinner", attributes: { "aria-hidden": "true" } }),
    h("div", {}, h("strong", {}, words), detail !== "" && h("p", {}, detail)),
  );
}

function inWords(state: Waiting, inside: boolean): [words: string, detail: string] {
  switch (state.kind) {
    case "connecting":
      return ["Connecting", ""];
    case "preparing":
      return state.firstStart
        ? ["The server is starting up", "The first time on a machine this takes up to a minute; then it is quick."]
        : ["Getting the picture ready", ""];
    case "reconnecting":
      return ["Connection lost. Reconnecting", state.problem?.detail ?? ""];
    case "sound":
      return [`Your connection is too slow for pictures${inside ? ": you still hear everybody" : ""}`, COME_BACK];
  }
}
