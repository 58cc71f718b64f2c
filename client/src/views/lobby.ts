/** Before the door, and after it: waiting to be let in, and why one is no longer there. */

import type { Attendance } from "../meeting/attendance";
import { Problem } from "../api/problem";
import type { Goodbye } from "../api/types";
import { announce, h } from "./dom";
import { button, notice, type View } from "./shell";

export function lobbyView(attendance: Attendance, onLeave: () => void): View {
  const words = h("p", { className: "lead" });
  const name = attendance.meeting.name || "the meeting";
  const title = h("h1", { tabIndex: -1 }, "Waiting to be let in");
  const element = h(
    "main",
    { className: "lobby", testId: "lobby-waiting" },
    h("span", { className: "spinner", attributes: { "aria-hidden": "true" } }),
    title,
    words,
    button("Don’t wait", onLeave, { testId: "lobby-leave" }),
  );
  const release = attendance.watch(() => {
    const lost = attendance.line.kind === "lost";
    const told = lost
      ? "Connection lost. Coming back; your place is kept."
      : `The host of “${name}” has been told that you are here. This page goes on by itself.`;
    if (words.textContent === told) return;
    words.textContent = told;
    announce(told);
  });
  return { element, close: () => void release() };
}

interface GoodbyeHooks {
  onBack(): void;
  onHere(): void;
}

export function goodbyeView(reason: Goodbye["reason"], problem: Problem | null, hooks: GoodbyeHooks): View {
  const told = problem ?? WORDS[reason] ?? LOST;
  const element = h(
    "main",
    { className: "trouble", testId: `goodbye-${reason}` },
    notice(
      told,
      reason === "replaced" && button("Go on here", hooks.onHere, { look: "primary" }),
      button("Back to the start", hooks.onBack, { testId: "goodbye-back" }),
    ),
  );
  return { element, close: () => undefined };
}

const LOST = new Problem("You are no longer in the meeting", "Your place was given to somebody else; join again.");
const WORDS: Partial<Record<Goodbye["reason"], Problem>> = {
  denied: new Problem("You were not let in", "The host of this meeting did not let you in."),
  removed: new Problem("You were sent out", "The host sent you out of this meeting. You see and hear nothing of it any more."),
  ended: new Problem("The meeting is over", "The host ended it for everybody."),
  replaced: new Problem("You are in this meeting in another tab", "Only one at a time can be you."),
};
