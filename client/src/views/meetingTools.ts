/** What a meeting has beside the picture: people, chat, signs, voices, screens, and what one sets rarely. */

import type { Api } from "../api/api";
import type { Attendance } from "../meeting/attendance";
import { inside, waiting } from "../meeting/state";
import { chatPanel } from "./chatPanel";
import { announce, h } from "./dom";
import type { IconName } from "./icons";
import { morePanel } from "./morePanel";
import { notesOn, type Notes } from "./notes";
import { peoplePanel } from "./peoplePanel";
import { recordingControls } from "./recordingControls";
import { screenView } from "./screenView";
import { button } from "./shell";
import { sidePanel, type Which } from "./sidePanel";
import { handButton, reactionButton } from "./signs";
import { voiceControls, type Surroundings } from "./voiceControls";

export interface MeetingTools {
  /** Along the lower edge. */
  dock: HTMLElement;
  /** Beside the picture, where one is open. */
  panel: HTMLElement;
  /** On the picture: who knocks, what was written, how people feel. */
  notes: HTMLElement;
  /** The screen that somebody shares. */
  screen: HTMLElement;
  /** What is spoken, in writing. */
  captions: HTMLElement;
  /** Have voices come from where their speakers stand, and a shared screen hang in the room. */
  bringInto(room: Surroundings & { showScreen(video: HTMLVideoElement | null): void }): void;
  /** As the microphone's button does. */
  toggleMicrophone(): void;
  close(): void;
}

export function meetingTools(api: Api, attendance: Attendance): MeetingTools {
  const complain = (words: string): void => notes.complain(words);
  const people = peoplePanel(attendance);
  const chat = chatPanel(attendance);
  const more = morePanel(api, attendance, complain);
  const screen = screenView(attendance, complain);
  const notes: Notes = notesOn(attendance, screen.knock);
  const voice = voiceControls(attendance, complain, (stream) => screen.show(stream));
  const hand = handButton(attendance);
  const reactions = reactionButton(attendance);
  const recording = recordingControls(attendance);
  notes.element.prepend(recording.note);
  const buttons: Record<Which, HTMLButtonElement> = {
    people: dockButton("people", "People", "people"),
    chat: dockButton("chat", "Chat", "chat"),
    more: dockButton("more", "More", "more"),
  };
  const panel = sidePanel(
    {
      people: { ...people, title: "People", toggle: buttons.people },
      chat: { ...chat, title: "Chat", toggle: buttons.chat },
      more: { ...more, title: "This meeting", toggle: buttons.more },
    },
    () => update(),
  );
  const dock = h("div", { className: "dock glass", attributes: { role: "toolbar", "aria-label": "Meeting" } });
  dock.append(buttons.people, buttons.chat, voice.element, hand.element, reactions.element, screen.toggle, recording.element, buttons.more, voice.player);
  const counts = counter(attendance, buttons, notes);
  const update = (): void => {
    for (const part of [people, chat, more, hand, voice, screen, recording]) part.update();
    counts(panel.which);
  };
  attendance.onNews = announce;
  attendance.onReaction = (reacted) => notes.react(reacted);
  attendance.onRefusal = ({ problem }) => notes.complain(problem.detail);
  const release = attendance.watch(update);
  for (const element of [panel.element, dock, notes.element, screen.panel]) keepFromStage(element);
  const close = (): void => {
    release();
    for (const part of [notes, voice, screen, more]) part.close();
  };
  return {
    dock,
    panel: panel.element,
    notes: notes.element,
    screen: screen.panel,
    captions: more.captionLine,
    bringInto: (room) => {
      voice.hearIn(room);
      screen.onShown = (video) => room.showScreen(video);
      screen.update();
    },
    toggleMicrophone: () => voice.element.click(),
    close,
  };
}

/** Counts on the buttons, and on the picture what is new and not looked at. */
function counter(
  attendance: Attendance,
  buttons: Record<Which, HTMLButtonElement>,
  notes: Notes,
): (which: Which | null) => void {
  return (which) => {
    const { state } = attendance;
    if (which === "chat") attendance.markRead();
    const unread = state.said.filter((one) => one.number > attendance.read && one.participant_id !== state.me);
    const [here, knocking] = [inside(state).length, waiting(state).length];
    badge(buttons.people, here, knocking > 0, `${here} here, ${knocking} waiting`);
    notes.update(which === "chat" ? [] : unread, which !== "people");
    badge(buttons.chat, unread.length, unread.length > 0, `${unread.length} new`);
  };
}

function dockButton(name: Which, label: string, icon: IconName): HTMLButtonElement {
  const made = button(label, () => undefined, { look: "glass", icon, testId: `open-${name}` });
  made.append(h("span", { className: "badge", attributes: { "aria-hidden": "true" } }), h("span", { className: "unseen" }));
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

/** Moves that begin here are none of the viewpoint. */
function keepFromStage(element: HTMLElement): void {
  for (const kind of ["pointerdown", "wheel", "dblclick", "contextmenu", "keydown"]) {
    element.addEventListener(kind, (event) => event.stopPropagation());
  }
}
