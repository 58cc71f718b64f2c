/** Notifications over the picture: lobby requests, new messages, reactions, a lost connection. */

import { lostText } from "../meeting/controlConnection";
import type { MeetingSession } from "../meeting/session";
import { activeSpeakers, waitingMembers } from "../meeting/state";
import type { Member, Reacted, Said } from "../api/types";
import { announce, h } from "./dom";
import { icon } from "./icons";
import { button } from "./shell";
import { REACTIONS } from "./reactions";

const REACTION_MS = 4000;
const PREVIEW_MS = 6000;

export interface Notifications {
  element: HTMLElement;
  /** `knocks`: whether to show who waits; not where the panel of people does. */
  update(unread: readonly Said[], knocks: boolean): void;
  react(reacted: Reacted): void;
  showError(words: string): void;
  close(): void;
}

export function notifications(session: MeetingSession, ...also: HTMLElement[]): Notifications {
  const talking = h("p", { className: "notification glass active-speakers", testId: "active-speakers", attributes: { "aria-hidden": "true" } });
  const lostWords = h("span");
  const lost = h("p", { className: "notification glass", testId: "connection-lost" }, h("span", { className: "spinner" }), lostWords);
  const knocks = h("div", { className: "knocks" });
  const previews = h("div", { className: "previews", attributes: { "aria-hidden": "true" } });
  const floats = h("div", { className: "reactions-shown", attributes: { "aria-hidden": "true" } });
  const element = h("div", { className: "notifications" }, lost, talking, knocks, ...also, previews, floats);
  const timers = new Set<ReturnType<typeof setTimeout>>();
  const knocking = new Map<string, HTMLElement>();
  let previewed = Math.max(session.lastRead, session.state.lastMessageNumber);

  const showFor = (place: HTMLElement, note: HTMLElement, milliseconds: number): void => {
    place.append(note);
    const timer = setTimeout(() => (note.remove(), timers.delete(timer)), milliseconds);
    timers.add(timer);
  };
  return {
    element,
    update: (unread, withKnocks) => {
      knocks.hidden = !withKnocks;
      const { connectionState } = session;
      lost.hidden = connectionState.kind !== "lost";
      if (connectionState.kind === "lost") {
        lostWords.textContent = lostText(connectionState);
        // how long to wait is said nowhere else
        lost.classList.toggle("merely-lost", connectionState.waitS === undefined);
      }
      const names = activeSpeakers(session.state);
      talking.hidden = names.length === 0;
      if (names.length > 0) talking.replaceChildren(icon("mic"), names.join(", "));
      showKnocks(session, knocks, knocking);
      // what was read meanwhile; a complaint stays its time
      if (unread.length === 0) for (const note of previews.querySelectorAll("[data-message]")) note.remove();
      for (const { number, name, text } of unread) {
        if (number <= previewed) continue;
        previewed = number;
        announce(`${name}: ${text}`);
        const note = h("p", { className: "notification glass" }, h("strong", {}, name), " ", text);
        note.dataset["message"] = String(number);
        showFor(previews, note, PREVIEW_MS);
      }
    },
    react: ({ reaction, name }) => {
      announce(`${name}: ${REACTIONS.find(([one]) => one === reaction)?.[1] ?? ""}`);
      showFor(floats, h("span", { className: "reaction-shown glass" }, icon(reaction), name), REACTION_MS);
    },
    showError: (words) => {
      announce(words);
      showFor(previews, h("p", { className: "notification glass" }, words), PREVIEW_MS);
    },
    close: () => timers.forEach(clearTimeout),
  };
}

/** One card for each who waits; only the host is told of any. */
function showKnocks(session: MeetingSession, place: HTMLElement, shown: Map<string, HTMLElement>): void {
  const there = waitingMembers(session.state);
  for (const [id, card] of shown) {
    if (there.some((member) => member.id === id)) continue;
    card.remove();
    shown.delete(id);
  }
  for (const member of there) {
    if (shown.has(member.id)) continue;
    const card = knock(session, member);
    shown.set(member.id, card);
    place.append(card);
  }
}

function knock(session: MeetingSession, { id, name }: Member): HTMLElement {
  const admit = button("Let in", () => session.send({ type: "admit", participant_id: id }), { look: "primary", testId: "knock-admit" });
  const deny = button("Deny", () => session.send({ type: "deny", participant_id: id }), { look: "glass", testId: "knock-deny" });
  admit.setAttribute("aria-label", `Let in: ${name}`);
  deny.setAttribute("aria-label", `Deny: ${name}`);
  const words = h("p", {}, h("strong", {}, name), " is asking to join");
  return h("div", { className: "notification knock glass", testId: "knock" }, words, admit, deny);
}
