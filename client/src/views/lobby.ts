/** The lobby, and the screen that says why one has left the meeting. */

import { lostText } from "../meeting/controlConnection";
import type { MeetingSession } from "../meeting/session";
import { Problem } from "../api/problem";
import type { Goodbye } from "../api/types";
import { announce, h } from "./dom";
import { button, notice, type View } from "./shell";

export function lobbyView(session: MeetingSession, onLeave: () => void): View {
  const words = h("p", { className: "lead" });
  const name = session.meeting.name || "the meeting";
  const title = h("h1", { tabIndex: -1 }, "Waiting to be let in");
  const element = h(
    "main",
    { className: "lobby", testId: "lobby-waiting" },
    h("span", { className: "spinner", attributes: { "aria-hidden": "true" } }),
    title,
    words,
    button("Leave the lobby", onLeave, { testId: "lobby-leave" }),
  );
  const release = session.subscribe(() => {
    const { connectionState } = session;
    const throttled = connectionState.kind === "lost" && connectionState.waitS !== undefined;
    title.textContent = throttled ? "Waiting for the server" : "Waiting to be let in";
    const told = connectionState.kind === "lost"
      ? `${lostText(connectionState)}${throttled ? "." : "; your place in the lobby is kept."}`
      : `The host of “${name}” knows that you are waiting. You join automatically once you are let in.`;
    if (words.textContent === told) return;
    words.textContent = told;
    announce(told);
  });
  return { element, close: () => void release() };
}

interface GoodbyeHooks {
  onStart(): void;
  onContinueHere(): void;
}

export function goodbyeView(reason: Goodbye["reason"], problem: Problem | null, hooks: GoodbyeHooks): View {
  const shown = problem ?? WORDS[reason] ?? LOST;
  const element = h(
    "main",
    { className: "problem-screen", testId: `goodbye-${reason}` },
    notice(
      shown,
      reason === "replaced" && button("Continue here", hooks.onContinueHere, { look: "primary" }),
      button("Back to the start", hooks.onStart, { testId: "goodbye-back" }),
    ),
  );
  return { element, close: () => undefined };
}

const LOST = new Problem("You are no longer in the meeting", "Your seat has expired. Join again.");
const WORDS: Partial<Record<Goodbye["reason"], Problem>> = {
  denied: new Problem("You were not let in", "The host of this meeting did not let you in."),
  removed: new Problem("You were removed", "The host removed you from this meeting."),
  ended: new Problem("The meeting is over", "The host ended it for everybody."),
  replaced: new Problem("You are in this meeting in another tab", "You can be in a meeting from one tab at a time."),
};
