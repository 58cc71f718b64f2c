/** What a meeting has beside the picture: people, chat, signs, voices, screens, and rarely changed settings. */

import type { Api } from "../api/api";
import type { MeetingSession } from "../meeting/session";
import { admittedMembers, waitingMembers } from "../meeting/state";
import { chatPanel } from "./chatPanel";
import { announce, h, keepFromViewport } from "./dom";
import type { IconName } from "./icons";
import { morePanel } from "./morePanel";
import { notifications, type Notifications } from "./notifications";
import { peoplePanel } from "./peoplePanel";
import { recordingControls } from "./recordingControls";
import { screenView } from "./screenView";
import { button } from "./shell";
import { sidePanel, type PanelName } from "./sidePanel";
import { handButton, reactionButton } from "./reactions";
import { voiceControls, type AudioScene } from "./voiceControls";

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
  connectTo(room: AudioScene & { showScreen(video: HTMLVideoElement | null): void }): void;
  /** Hear now and at each change whether the network is poor, until the returned function is called. */
  watchNetwork(listener: (poor: boolean) => void): () => void;
  /** Say something on the picture, for a while. */
  notify(words: string): void;
  /** As the microphone's button does. */
  toggleMicrophone(): void;
  close(): void;
}

export function meetingTools(api: Api, session: MeetingSession): MeetingTools {
  const showError = (words: string): void => notes.showError(words);
  const people = peoplePanel(session);
  const chat = chatPanel(session);
  const more = morePanel(api, session, showError);
  const screen = screenView(session, showError);
  const notes: Notifications = notifications(session, screen.knock);
  const voice = voiceControls(session, showError, (stream) => screen.show(stream));
  const hand = handButton(session);
  const reactions = reactionButton(session);
  const recording = recordingControls(session);
  notes.element.prepend(recording.note);
  const buttons: Record<PanelName, HTMLButtonElement> = {
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
  const counts = unreadCounter(session, buttons, notes);
  const update = (): void => {
    for (const part of [people, chat, more, hand, voice, screen, recording]) part.update();
    counts(panel.open);
  };
  session.onAnnouncement = announce;
  session.onReaction = (reacted) => notes.react(reacted);
  session.onRefusal = ({ problem }) => notes.showError(problem.detail);
  const release = session.subscribe(update);
  for (const element of [panel.element, dock, notes.element, screen.panel]) keepFromViewport(element);
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
    connectTo: (room) => {
      voice.spatialiseIn(room);
      screen.onShown = (video) => room.showScreen(video);
      screen.update();
    },
    watchNetwork: (listener) => session.subscribe(() => listener(session.network === "poor")),
    notify: showError,
    toggleMicrophone: () => voice.element.click(),
    close,
  };
}

/** Counts on the buttons, and on the picture what is new and not looked at. */
function unreadCounter(
  session: MeetingSession,
  buttons: Record<PanelName, HTMLButtonElement>,
  notes: Notifications,
): (which: PanelName | null) => void {
  return (which) => {
    const { state } = session;
    if (which === "chat") session.markRead();
    const unread = state.messages.filter((one) => one.number > session.lastRead && one.participant_id !== state.me);
    const [here, knocking] = [admittedMembers(state).length, waitingMembers(state).length];
    badge(buttons.people, here, knocking > 0, `${here} here, ${knocking} waiting`);
    notes.update(which === "chat" ? [] : unread, which !== "people");
    badge(buttons.chat, unread.length, unread.length > 0, `${unread.length} new`);
  };
}

function dockButton(name: PanelName, label: string, icon: IconName): HTMLButtonElement {
  const made = button(label, () => undefined, { look: "glass", icon, testId: `open-${name}` });
  made.append(h("span", { className: "badge", attributes: { "aria-hidden": "true" } }), h("span", { className: "visually-hidden" }));
  return made;
}

function badge(on: HTMLButtonElement, count: number, strong: boolean, words: string): void {
  const mark = on.querySelector<HTMLElement>(".badge");
  if (!mark) return;
  mark.textContent = count > 0 ? String(count) : "";
  mark.classList.toggle("strong", strong);
  const told = on.querySelector(".visually-hidden");
  if (told) told.textContent = count > 0 ? `, ${words}` : "";
}
