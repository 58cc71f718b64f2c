/** Raising a hand, and reactions. */

import type { MeetingSession } from "../meeting/session";
import { localParticipant, type Reaction } from "../meeting/state";
import { h } from "./dom";
import { button } from "./shell";

export const REACTIONS: [Reaction, string][] = [
  ["agree", "Agree"],
  ["applause", "Applause"],
  ["heart", "Heart"],
  ["laugh", "Laugh"],
  ["surprise", "Surprise"],
  ["party", "Celebrate"],
];

export function handButton(session: MeetingSession): { element: HTMLButtonElement; update(): void } {
  const raised = (): boolean => localParticipant(session.state)?.hand_at != null;
  const element = button("Raise hand", () => session.send({ type: "hand", raised: !raised() }), {
    look: "glass",
    icon: "hand",
    testId: "hand",
  });
  return { element, update: () => element.setAttribute("aria-pressed", String(raised())) };
}

export function reactionButton(session: MeetingSession): { element: HTMLElement } {
  const choices = h("div", { className: "reactions glass", hidden: true, attributes: { role: "group" } });
  choices.setAttribute("aria-label", "Reactions");
  choices.id = "reactions";
  const main = button("React", () => show(choices.hidden !== false), { look: "glass", icon: "smile", testId: "react" });
  const show = (shown: boolean): void => {
    choices.hidden = !shown;
    main.setAttribute("aria-expanded", String(shown));
  };
  main.setAttribute("aria-controls", choices.id);
  show(false);
  for (const [reaction, label] of REACTIONS) {
    const one = button(label, () => (session.send({ type: "react", reaction }), show(false), main.focus()), {
      look: "glass",
      icon: reaction,
      testId: `react-${reaction}`,
    });
    one.title = label;
    choices.append(one);
  }
  const element = h("div", { className: "reaction-menu" }, main, choices);
  element.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || choices.hidden) return;
    show(false);
    main.focus();
  });
  return { element };
}
