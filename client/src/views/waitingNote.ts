/** What one waits for while there is no picture, and that there is audio only. */

import type { LiveState } from "../drawing/liveState";
import { announce, h } from "./dom";
import { icon } from "./icons";

const VIDEO_RESUMES = "Video resumes automatically when the connection improves.";

type Waiting = Exclude<LiveState, { kind: "live" | "refused" }>;

/** `inside` the meeting one hears the others; before it one only looks. */
export function waitingNote(state: Waiting, inside: boolean): HTMLElement {
  const [words, detail] = waitingText(state, inside);
  announce(words);
  const sound = state.kind === "audio-only";
  return h(
    "div",
    { className: `waiting-notice glass ${state.kind}`, testId: sound ? "audio-only" : "waiting" },
    sound ? icon("sound") : h("span", { className: "spinner", attributes: { "aria-hidden": "true" } }),
    h("div", {}, h("strong", {}, words), detail !== "" && h("p", {}, detail)),
  );
}

function waitingText(state: Waiting, inside: boolean): [words: string, detail: string] {
  switch (state.kind) {
    case "connecting":
      return ["Connecting", ""];
    case "preparing":
      return state.firstStart
        ? ["The server is starting up", "The first start on a machine takes up to a minute; later starts are quick."]
        : ["Preparing the picture", ""];
    case "reconnecting":
      return ["Connection lost. Reconnecting", state.problem?.detail ?? ""];
    case "audio-only":
      return [`Your connection is too slow for video.${inside ? " You can still hear everybody." : ""}`, VIDEO_RESUMES];
  }
}
