/** The meeting: the live picture, filling the window, and the little that lies on it. */

import { steerWith } from "../viewpoint/controls";
import type { LiveNumbers, LiveState, LiveView } from "../drawing/live";
import type { Choice, Drawing } from "../splats/way";
import type { Performer } from "../api/types";
import { moveFocusByArrows } from "./arrowFocus";
import { beSeenView } from "./beSeen";
import { announce, h, usesTouch } from "./dom";
import { icon, mark } from "./icons";
import { improveMeView } from "./improveMe";
import type { MeetingTools } from "./meetingTools";
import { button, notice, type View } from "./shell";
import { waitingNote } from "./waitingNote";

interface StageHooks {
  onLeave(): void;
  onRetry(): void;
}

const CLOSE_UP_M = 2.6;
const HINT_MS = 6000;
const COPIED_MS = 2000;
const CHEST_M = 0.95;

/** The way into a headset: what the view shows of it, and ends with itself. */
export interface HeadsetControl {
  element: HTMLElement;
  close(): void;
}

export function stageView(live: LiveView, tools: MeetingTools, headset: HeadsetControl, hooks: StageHooks): View {
  live.video.dataset["testid"] = "stage-video";
  live.video.setAttribute("aria-label", `Live picture of ${live.meeting.name || "the meeting"}`);
  const hint = stageHint();
  const people = h("div", { className: "people", attributes: { role: "group", "aria-label": "Who is here" } });
  const numbers = liveNumbers();
  const middle = h("div", { className: "middle" });
  const way = waySwitch((choice) => live.choose(choice));
  const self = beSeenView(live);
  const better = improveMeView(live, self.camera);
  const element = h(
    "main",
    { className: "stage", tabIndex: 0, attributes: { "aria-describedby": hint.element.id, "aria-label": "The meeting" } },
    live.video,
    live.canvas,
    tools.screen,
    middle,
    stageTop(live, people, hooks),
    h(
      "div",
      { className: "stage-bottom" },
      h("div", { className: "stage-self" }, self.element, better.element, numbers.element),
      hint.element,
      tools.dock,
      h("div", { className: "stage-ways" }, self.toggle, better.toggle, ...viewButtons(live), way.element, headset.element, hint.toggle),
    ),
    tools.captions,
    tools.notes,
    tools.panel,
  );
  element.addEventListener("dragstart", (event) => event.preventDefault());
  const ends = [
    steerWith(element, live.viewpoint, hint.used),
    moveFocusByArrows(element, () => tools.dock.querySelector("button") ?? element),
  ];
  tools.bringInto(live);
  live.onNumbers = numbers.show;
  live.onState = (state) => {
    if (state.kind === "live") announce(element.classList.contains("sound") ? "Pictures are back" : "Connected");
    element.classList.toggle("sound", state.kind === "sound");
    middle.replaceChildren(...stateInWords(state, hooks));
  };
  live.onPerformers = (performers) => showPeople(people, performers, live);
  live.onDrawing = (drawing) => {
    way.show(drawing);
    // where this device draws, a shared screen hangs in the room
    element.classList.toggle("draws", drawing.way === "local");
  };
  live.onState(live.state);
  showPeople(people, live.meeting.performers, live);
  return {
    element,
    close: () => {
      for (const part of [hint, self, better, headset, tools]) part.close();
      for (const end of ends) end();
    },
  };
}

/** Which meeting it is, who stands in it, the ways out and for others in. */
function stageTop(live: LiveView, people: HTMLElement, hooks: StageHooks): HTMLElement {
  return h(
    "div",
    { className: "stage-top" },
    h("p", { className: "stage-name glass" }, mark(), h("span", {}, live.meeting.name || "Meeting")),
    people,
    h(
      "div",
      { className: "stage-ways" },
      inviteButton(live.meeting.join_url),
      button("Leave", hooks.onLeave, { look: "glass", icon: "leave", testId: "leave" }),
    ),
  );
}

/** Back to the first view; and only what a camera saw. */
function viewButtons(live: LiveView): HTMLButtonElement[] {
  const first = button("First view", () => live.viewpoint.reset(), { look: "glass", icon: "reset" });
  first.title = "First view";
  const toggle = (): void => {
    const on = filmed.getAttribute("aria-pressed") !== "true";
    filmed.setAttribute("aria-pressed", String(on));
    live.showFilmedOnly(on);
  };
  const filmed = button("Only what was filmed", toggle, { look: "glass", icon: "filmed", testId: "filmed-only" });
  filmed.title = "Show only what was filmed: parts that no camera saw fade away";
  filmed.setAttribute("aria-pressed", "false");
  return [first, filmed];
}

/** How to look round: shown at first, and whenever it is asked for. */
function stageHint(): { element: HTMLElement; toggle: HTMLButtonElement; used(): void; close(): void } {
  const element = h("div", { className: "hint glass", id: "stage-hint" }, ...controlsInWords());
  const toggle = button("Controls", () => flip(), { look: "glass", icon: "help" });
  toggle.title = "Controls";
  toggle.setAttribute("aria-controls", element.id);
  let hiding: ReturnType<typeof setTimeout> | undefined;
  const show = (shown: boolean): void => {
    element.classList.toggle("away", !shown);
    toggle.setAttribute("aria-expanded", String(shown));
  };
  const flip = (): void => {
    clearTimeout(hiding);
    hiding = undefined;
    show(element.classList.contains("away"));
  };
  show(true);
  return {
    element,
    toggle,
    // once somebody has found out how it goes, the words step aside
    used: () => {
      hiding ??= setTimeout(() => show(false), HINT_MS);
    },
    close: () => clearTimeout(hiding),
  };
}

const CHOICES: readonly [Choice, string][] = [
  ["automatic", "Automatic"],
  ["local", "This device"],
  ["server", "Server"],
];

/** Who draws the picture: shows who does, and lets the viewer choose. */
function waySwitch(onChoice: (choice: Choice) => void): {
  element: HTMLElement;
  show(drawing: Drawing): void;
} {
  const options = CHOICES.map(([value, words]) => h("option", { value }, words));
  const select = h("select", { testId: "way" }, ...options);
  select.setAttribute("aria-label", "Who draws the picture");
  select.addEventListener("change", () => onChoice(select.value as Choice));
  const words = h("span", {}, "Drawn by the server");
  const element = h("label", { className: "button glass way" }, icon("screen"), words, select);
  return {
    element,
    show: ({ choice, way, obstacle }) => {
      select.value = choice;
      select.dataset["way"] = way;
      element.title = obstacle ?? "Who draws the picture: whichever does it better, this device, or the server";
      options.forEach((option, index) => (option.disabled = CHOICES[index]?.[0] === "local" && obstacle !== null));
      words.textContent = way === "local" ? "Drawn here" : "Drawn by the server";
    },
  };
}

function stateInWords(state: LiveState, hooks: StageHooks): HTMLElement[] {
  switch (state.kind) {
    case "live":
      return [];
    case "connecting":
    case "preparing":
    case "reconnecting":
    case "sound":
      return [waitingNote(state, true)];
    case "refused":
      return [
        h(
          "div",
          { className: "sheet" },
          notice(
            state.problem,
            button("Try again", hooks.onRetry, { look: "primary" }),
            button("Back to the start", hooks.onLeave),
          ),
        ),
      ];
  }
}

function liveNumbers(): { element: HTMLElement; show(news: LiveNumbers): void } {
  const fps = h("span", { testId: "fps" });
  fps.dataset["fps"] = fps.dataset["frames"] = "0";
  const element = h("p", { className: "numbers glass", attributes: { "aria-hidden": "true" } }, fps);
  return {
    element,
    show: (news) => {
      fps.dataset["fps"] = String(news.fps);
      fps.dataset["frames"] = String(news.framesDecoded);
      fps.textContent = `${news.fps} fps`;
      const rest = [
        news.width > 0 && `${news.width} × ${news.height}`,
        news.roundTripMs !== null && `${Math.max(1, Math.round(news.roundTripMs))} ms`,
      ].filter((part): part is string => part !== false);
      element.replaceChildren(fps, ...rest.map((part) => h("span", {}, part)));
    },
  };
}

/** A press on a name brings the viewer close to that person. */
function showPeople(people: HTMLElement, performers: readonly Performer[], live: LiveView): void {
  const key = performers.map(({ id, name }) => `${id} ${name}`).join();
  if (people.dataset["key"] === key) return;
  people.dataset["key"] = key;
  people.replaceChildren(
    ...performers.map(({ name, position: [x, , z] }) => {
      const chip = button(name, () => live.viewpoint.lookAt([x, CHEST_M, z], CLOSE_UP_M), {
        look: "glass",
      });
      chip.setAttribute("aria-label", `Look at ${name}`);
      return chip;
    }),
  );
}

/** The server writes the link, with a token where one is needed; the address is this page's own. */
function inviteButton(joinUrl: string): HTMLElement {
  const invite = button("Copy invite link", () => void copy(), { look: "glass", icon: "link" });
  const label = invite.querySelector("span");
  const say = (words: string): void => {
    if (label) label.textContent = words;
    announce(words);
  };
  const copy = async (): Promise<void> => {
    const { search, hash } = new URL(joinUrl, location.href);
    const link = `${location.origin}/${search}${hash}`;
    try {
      await navigator.clipboard.writeText(link);
      say("Copied");
    } catch {
      // only secure addresses may write to the clipboard; then people copy by hand
      prompt("Send this link to whom you want to meet:", link);
    }
    setTimeout(() => say("Copy invite link"), COPIED_MS);
  };
  return invite;
}

function controlsInWords(): HTMLElement[] {
  const lines: [string, string][] = usesTouch()
    ? [
        ["One finger", "look around"],
        ["Pinch", "come closer"],
        ["Two fingers", "move along"],
        ["Double tap", "first view"],
      ]
    : [
        ["Drag", "look around"],
        ["Scroll", "come closer"],
        ["W A S D", "walk, Shift is faster"],
        ["R", "first view"],
        ["Enter", "the buttons"],
      ];
  return lines.map(([key, what]) => h("span", {}, h("kbd", {}, key), what));
}

