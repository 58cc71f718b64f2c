/** A raised hand, and passing signs to all. */

import type { Attendance } from "../meeting/attendance";
import { myself, type Reaction } from "../meeting/state";
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

export function handButton(attendance: Attendance): { element: HTMLButtonElement; update(): void } {
  const raised = (): boolean => myself(attendance.state)?.hand_at != null;
  const element = button("Raise hand", () => attendance.wish({ type: "hand", raised: !raised() }), {
    look: "glass",
    icon: "hand",
    testId: "hand",
  });
  return { element, update: () => element.setAttribute("aria-pressed", String(raised())) };
}

export function reactionButton(attendance: Attendance): { element: HTMLElement } {
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
    const one = button(label, () => (attendance.wish({ type: "react", reaction }), show(false), main.focus()), {
      look: "glass",
      icon: reaction,
      testId: `react-${reaction}`,
    });
    one.title = label;
    choices.append(one);
  }
  const element = h("div", { className: "react" }, main, choices);
  element.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || choices.hidden) return;
    show(false);
    main.focus();
  });
  return { element };
}
