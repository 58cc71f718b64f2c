/** On the picture: who knocks, what was written, how people feel, that the line is lost. */

import type { Attendance } from "../meeting/attendance";
import { speakers, waiting } from "../meeting/state";
import type { Member, Reacted, Said } from "../api/types";
import { announce, h } from "./dom";
import { icon } from "./icons";
import { button } from "./shell";
import { REACTIONS } from "./signs";

const REACTION_MS = 4000;
const PREVIEW_MS = 6000;

export interface Notes {
  element: HTMLElement;
  /** `knocks`: whether to show who waits; not where the panel of people does. */
  update(unread: readonly Said[], knocks: boolean): void;
  react(reacted: Reacted): void;
  complain(words: string): void;
  close(): void;
}

export function notesOn(attendance: Attendance, ...also: HTMLElement[]): Notes {
  const talking = h("p", { className: "note glass talking", testId: "talking", attributes: { "aria-hidden": "true" } });
  const lost = h("p", { className: "note glass", testId: "line-lost" }, h("span", { className: "spinner" }), "Connection lost. Coming back");
  const knocks = h("div", { className: "knocks" });
  const previews = h("div", { className: "previews", attributes: { "aria-hidden": "true" } });
  const floats = h("div", { className: "floats", attributes: { "aria-hidden": "true" } });
  const element = h("div", { className: "notes" }, lost, talking, knocks, ...also, previews, floats);
  const timers = new Set<ReturnType<typeof setTimeout>>();
  const knocking = new Map<string, HTMLElement>();
  let previewed = Math.max(attendance.read, attendance.state.number);

  const passing = (place: HTMLElement, note: HTMLElement, milliseconds: number): void => {
    place.append(note);
    const timer = setTimeout(() => (note.remove(), timers.delete(timer)), milliseconds);
    timers.add(timer);
  };
  return {
    element,
    update: (unread, withKnocks) => {
      knocks.hidden = !withKnocks;
      lost.hidden = attendance.line.kind !== "lost";
      const names = speakers(attendance.state);
      talking.hidden = names.length === 0;
      if (names.length > 0) talking.replaceChildren(icon("mic"), names.join(", "));
      showKnocks(attendance, knocks, knocking);
      // what was read meanwhile; a complaint stays its time
      if (unread.length === 0) for (const note of previews.querySelectorAll("[data-said]")) note.remove();
      for (const { number, name, text } of unread) {
        if (number <= previewed) continue;
        previewed = number;
        announce(`${name}: ${text}`);
        const note = h("p", { className: "note glass" }, h("strong", {}, name), " ", text);
        note.dataset["said"] = String(number);
        passing(previews, note, PREVIEW_MS);
      }
    },
    react: ({ reaction, name }) => {
      announce(`${name}: ${REACTIONS.find(([one]) => one === reaction)?.[1] ?? ""}`);
      passing(floats, h("span", { className: "float glass" }, icon(reaction), name), REACTION_MS);
    },
    complain: (words) => {
      announce(words);
      passing(previews, h("p", { className: "note glass" }, words), PREVIEW_MS);
    },
    close: () => timers.forEach(clearTimeout),
  };
}

/** One card for each who waits; only the host is told of any. */
function showKnocks(attendance: Attendance, place: HTMLElement, shown: Map<string, HTMLElement>): void {
  const there = waiting(attendance.state);
  for (const [id, card] of shown) {
    if (there.some((member) => member.id === id)) continue;
    card.remove();
    shown.delete(id);
  }
  for (const member of there) {
    if (shown.has(member.id)) continue;
    const card = knock(attendance, member);
    shown.set(member.id, card);
    place.append(card);
  }
}

function knock(attendance: Attendance, { id, name }: Member): HTMLElement {
  const admit = button("Let in", () => attendance.wish({ type: "admit", participant_id: id }), { look: "primary", testId: "knock-admit" });
  const deny = button("Deny", () => attendance.wish({ type: "deny", participant_id: id }), { look: "glass", testId: "knock-deny" });
  admit.setAttribute("aria-label", `Let in: ${name}`);
  deny.setAttribute("aria-label", `Deny: ${name}`);
  const words = h("p", {}, h("strong", {}, name), " wants to come in");
  return h("div", { className: "note knock glass", testId: "knock" }, words, admit, deny);
}
