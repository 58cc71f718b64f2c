/** What a meeting has beside the picture: people, chat, a raised hand, reactions, who knocks. */

import type { Attendance } from "../meeting/attendance";
import { inside, myself, speakers, waiting, type Reaction } from "../meeting/state";
import type { Member, Reacted, Said } from "../types";
import { chatPanel } from "./chatPanel";
import { announce, h } from "./dom";
import { icon } from "./icons";
import { peoplePanel } from "./peoplePanel";
import { button } from "./shell";
import { voiceControls } from "./voiceControls";

export interface MeetingTools {
  /** Along the lower edge. */
  dock: HTMLElement;
  /** Beside the picture, where one is open. */
  panel: HTMLElement;
  /** On the picture: who knocks, what was written, how people feel. */
  notes: HTMLElement;
  close(): void;
}

type Which = "people" | "chat";

const REACTIONS: [Reaction, string][] = [
  ["agree", "Agree"],
  ["applause", "Applause"],
  ["heart", "Heart"],
  ["laugh", "Laugh"],
  ["surprise", "Surprise"],
  ["party", "Celebrate"],
];
const TITLES: Record<Which, string> = { people: "People", chat: "Chat" };
const REACTION_MS = 4000;
const PREVIEW_MS = 6000;

export function meetingTools(attendance: Attendance): MeetingTools {
  const people = peoplePanel(attendance);
  const chat = chatPanel(attendance);
  const title = h("h2", { tabIndex: -1 });
  const shut = button("Close", () => open(null), { icon: "close", testId: "panel-close" });
  shut.classList.add("bare");
  const panel = h(
    "section",
    { className: "panel", hidden: true, testId: "panel", attributes: { "aria-labelledby": "panel-title" } },
    h("header", { className: "panel-head" }, title, shut),
    people.element,
    chat.element,
  );
  title.id = "panel-title";
  const buttons: Record<Which, HTMLButtonElement> = {
    people: dockButton("people", "People", () => toggle("people")),
    chat: dockButton("chat", "Chat", () => toggle("chat")),
  };
  const hand = handButton(attendance);
  const reactions = reactionButton(attendance);
  const dock = h("div", { className: "dock glass", attributes: { role: "toolbar", "aria-label": "Meeting" } });
  const notes = notesOn(attendance);
  const voice = voiceControls(attendance, (words) => notes.complain(words));
  dock.append(buttons.people, buttons.chat, voice.element, hand.element, reactions.element, voice.player);
  let which: Which | null = null;
  let read = attendance.state.number;

  const open = (next: Which | null): void => {
    const last = which;
    which = next;
    panel.hidden = next === null;
    people.element.hidden = next !== "people";
    chat.element.hidden = next !== "chat";
    for (const [name, one] of Object.entries(buttons)) one.setAttribute("aria-expanded", String(name === next));
    update();
    if (next === null) {
      if (last) buttons[last].focus();
      return;
    }
    title.textContent = TITLES[next];
    if (next === "chat") chat.focus();
    else title.focus();
  };
  const toggle = (one: Which): void => open(which === one ? null : one);
  panel.addEventListener("keydown", (event) => {
    if (event.key === "Escape") open(null);
  });

  const update = (): void => {
    const { state } = attendance;
    people.update();
    chat.update();
    hand.update();
    voice.update();
    if (which === "chat") read = state.number;
    const unread = state.said.filter((one) => one.number > read && one.participant_id !== state.me);
    const knocking = waiting(state).length;
    badge(buttons.people, inside(state).length, knocking > 0, `${inside(state).length} here, ${knocking} waiting`);
    notes.update(which === "chat" ? [] : unread, which !== "people");
    badge(buttons.chat, unread.length, unread.length > 0, `${unread.length} new`);
  };
  attendance.onNews = announce;
  attendance.onReaction = (reacted) => notes.react(reacted);
  attendance.onRefusal = ({ problem }) => notes.complain(problem.detail);
  const release = attendance.watch(update);
  for (const element of [panel, dock, notes.element]) keepFromStage(element);
  return { dock, panel, notes: notes.element, close: () => (release(), notes.close(), voice.close()) };
}

function dockButton(name: Which, label: string, onClick: () => void): HTMLButtonElement {
  const made = button(label, onClick, { look: "glass", icon: name, testId: `open-${name}` });
  made.append(h("span", { className: "badge", attributes: { "aria-hidden": "true" } }), h("span", { className: "unseen" }));
  made.setAttribute("aria-expanded", "false");
  return made;
}

function badge(on: HTMLButtonElement, count: number, strong: boolean, words: string): void {
  const mark = on.querySelector<HTMLElement>(".badge");
  if (!mark) return;
  mark.textContent = count > 0 ? String(count) : "";
  mark.classList.toggle("strong", strong);
  const told = on.querySelector(".unseen");
  if (told) told.textContent = count > 0 ? `, ${words}` : "";
}

function handButton(attendance: Attendance): { element: HTMLButtonElement; update(): void } {
  const raised = (): boolean => myself(attendance.state)?.hand_at != null;
  const element = button("Raise hand", () => attendance.wish({ type: "hand", raised: !raised() }), {
    look: "glass",
    icon: "hand",
    testId: "hand",
  });
  return { element, update: () => element.setAttribute("aria-pressed", String(raised())) };
}

function reactionButton(attendance: Attendance): { element: HTMLElement } {
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

interface Notes {
  element: HTMLElement;
  /** `knocks`: whether to show who waits; not where the panel of people does. */
  update(unread: readonly Said[], knocks: boolean): void;
  react(reacted: Reacted): void;
  complain(words: string): void;
  close(): void;
}

function notesOn(attendance: Attendance): Notes {
  const talking = h("p", { className: "note glass talking", testId: "talking", attributes: { "aria-hidden": "true" } });
  const lost = h("p", { className: "note glass", testId: "line-lost" }, h("span", { className: "spinner" }), "Connection lost. Coming back");
  const knocks = h("div", { className: "knocks" });
  const previews = h("div", { className: "previews", attributes: { "aria-hidden": "true" } });
  const floats = h("div", { className: "floats", attributes: { "aria-hidden": "true" } });
  const element = h("div", { className: "notes" }, lost, talking, knocks, previews, floats);
  const timers = new Set<ReturnType<typeof setTimeout>>();
  const knocking = new Map<string, HTMLElement>();
  let previewed = attendance.state.number;

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
      if (unread.length === 0) previews.replaceChildren();
      for (const { number, name, text } of unread) {
        if (number <= previewed) continue;
        previewed = number;
        announce(`${name}: ${text}`);
        passing(previews, h("p", { className: "note glass" }, h("strong", {}, name), " ", text), PREVIEW_MS);
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

/** Moves that begin here are none of the viewpoint. */
function keepFromStage(element: HTMLElement): void {
  for (const kind of ["pointerdown", "wheel", "dblclick", "contextmenu", "keydown"]) {
    element.addEventListener(kind, (event) => event.stopPropagation());
  }
}
