/** The meeting: the live picture, filling the window, and the little that lies on it. */

import { attachControls } from "../viewpoint/controls";
import type { LiveView } from "../drawing/live";
import type { LiveStats, LiveState } from "../drawing/liveState";
import { linkWithKey } from "../sealing/meetingKey";
import type { RenderSetting, RenderStatus } from "../splats/renderMode";
import type { Performer } from "../api/types";
import { moveFocusByArrows } from "./arrowFocus";
import { motionCaptureView } from "./motionCapture";
import { announce, h, isNarrow, usesTouch } from "./dom";
import { icon } from "./icons";
import { improveModelView } from "./improveModel";
import type { MeetingTools } from "./meetingTools";
import { sealedNote } from "./sealedNote";
import { button, notice, viewportTitle, type View } from "./shell";
import { waitingNote } from "./waitingNote";

interface MeetingViewHooks {
  onLeave(): void;
  onRetry(): void;
}

const HINT_MS = 6000;
/** How one looks round. */
const BRIEF_LINES = 2;
const COPIED_MS = 2000;
const YOU_ARE_GONE = "You are no longer shown: your consent has ended, or you were taken out. See “Your consent” under More.";

/** The way into a headset: what the view shows of it, and ends with itself. */
export interface HeadsetControl {
  element: HTMLElement;
  close(): void;
}

export function meetingView(live: LiveView, tools: MeetingTools, headset: HeadsetControl, hooks: MeetingViewHooks): View {
  live.video.dataset["testid"] = "live-video";
  live.video.setAttribute("aria-label", `Live picture of ${live.meeting.name || "the meeting"}`);
  const hint = controlsHint();
  const people = h("div", { className: "performers", attributes: { role: "group", "aria-label": "People in the meeting" } });
  const numbers = statsLine();
  const middle = h("div", { className: "viewport-centre" });
  const way = renderModeSelect((choice) => live.chooseRenderMode(choice));
  // nobody else can draw a sealed meeting
  way.element.hidden = live.sealing !== null;
  const sealed = sealedNote(live.sealing);
  const self = motionCaptureView(live);
  const better = improveModelView(live, self.camera);
  const element = h(
    "main",
    { className: "viewport", tabIndex: 0, attributes: { "aria-describedby": hint.element.id, "aria-label": "The meeting" } },
    live.video,
    live.canvas,
    tools.screen,
    middle,
    topBar(live, people, sealed?.element ?? null, { ...hooks, onLeave: () => void self.settle().then(hooks.onLeave) }),
    h(
      "div",
      { className: "viewport-bottom" },
      h("div", { className: "viewport-self" }, self.element, better.element, numbers.element),
      hint.element,
      tools.dock,
      h("div", { className: "viewport-actions" }, self.toggle, better.toggle, ...viewButtons(live), way.element, headset.element, hint.toggle),
    ),
    tools.captions,
    tools.notes,
    tools.panel,
  );
  element.addEventListener("dragstart", (event) => event.preventDefault());
  let poorNetwork = false;
  // pictures of oneself are the first to give way
  const makeRoom = (): void => self.setPoorNetwork(poorNetwork || live.state.kind === "audio-only");
  const ends = [
    tools.watchNetwork((poor) => {
      poorNetwork = poor;
      makeRoom();
    }),
    attachControls(element, live.viewpoint, hint.used),
    moveFocusByArrows(element, () => tools.dock.querySelector("button") ?? element),
  ];
  tools.connectTo(live);
  live.onStats = numbers.show;
  live.onState = (state) => {
    if (state.kind === "live") announce(element.classList.contains("audio-only") ? "Video is back" : "Connected");
    element.classList.toggle("audio-only", state.kind === "audio-only");
    middle.replaceChildren(...stateNotice(state, hooks));
    makeRoom();
  };
  live.onPerformers = (performers) => {
    showPerformers(people, performers, live);
    self.update();
  };
  live.onGone = (gone) => {
    for (const { name, owner } of gone) tools.notify(owner === "own" ? YOU_ARE_GONE : `${name} is no longer shown`);
  };
  live.onRenderStatus = (drawing) => {
    way.show(drawing);
    // that nobody is here hinders nothing
    sealed?.setObstacle(live.meeting.performers.length > 0 ? drawing.obstacle : null);
    // where this device draws, a shared screen hangs in the room
    element.classList.toggle("renders-locally", drawing.mode === "local");
  };
  live.onState(live.state);
  showPerformers(people, live.meeting.performers, live);
  return {
    element,
    close: () => {
      for (const part of [hint, self, better, headset, tools]) part.close();
      for (const end of ends) end();
    },
  };
}

/** Which meeting it is, who stands in it, the ways out and for others in. */
function topBar(live: LiveView, people: HTMLElement, sealed: HTMLElement | null, hooks: MeetingViewHooks): HTMLElement {
  return h(
    "div",
    { className: "viewport-top" },
    h("div", { className: "viewport-head" }, viewportTitle(live.meeting.name || "Meeting"), sealed),
    people,
    h(
      "div",
      { className: "viewport-actions" },
      // without the key a link shows nobody moving
      !(live.sealing && !live.sealing.key) && inviteButton(() => linkWithKey(live.meeting.join_url, live.sealing?.key ?? null)),
      button("Leave", hooks.onLeave, { look: "glass", icon: "leave", testId: "leave" }),
    ),
  );
}

/** Back to the first view; and parts that no camera saw. */
function viewButtons(live: LiveView): HTMLButtonElement[] {
  const first = button("Reset view", () => live.viewpoint.reset(), { look: "glass", icon: "reset" });
  first.title = "Reset view";
  const toggle = (): void => {
    const on = invented.getAttribute("aria-pressed") !== "true";
    invented.setAttribute("aria-pressed", String(on));
    live.setHideUnseen(!on);
  };
  const invented = button("Show parts never filmed", toggle, { look: "glass", icon: "filmed", testId: "show-unseen" });
  invented.title = "Show the parts of the body that no camera saw; they are invented";
  invented.setAttribute("aria-pressed", "false");
  return [first, invented];
}

/** How to look round: shown at first, and whenever it is asked for. */
function controlsHint(): { element: HTMLElement; toggle: HTMLButtonElement; used(): void; close(): void } {
  const element = h("div", { className: "controls-help glass", id: "controls-help" }, ...controlsHelp());
  const toggle = button("Controls", () => flip(), { look: "glass", icon: "help" });
  toggle.title = "Controls";
  toggle.setAttribute("aria-controls", element.id);
  let hiding: ReturnType<typeof setTimeout> | undefined;
  const show = (amount: "none" | "brief" | "all"): void => {
    element.classList.toggle("away", amount === "none");
    // who listens gets the rest nevertheless
    [...element.children].slice(BRIEF_LINES).forEach((line) => line.classList.toggle("visually-hidden", amount === "brief"));
    toggle.setAttribute("aria-expanded", String(amount === "all"));
  };
  const flip = (): void => {
    clearTimeout(hiding);
    hiding = undefined;
    show(toggle.getAttribute("aria-expanded") === "true" ? "none" : "all");
  };
  // in a narrow window all of it, unasked, would lie over the people
  show(isNarrow() ? "brief" : "all");
  return {
    element,
    toggle,
    // once somebody has found out how it goes, the words step aside
    used: () => {
      hiding ??= setTimeout(() => show("none"), HINT_MS);
    },
    close: () => clearTimeout(hiding),
  };
}

const RENDER_SETTINGS: readonly [RenderSetting, string][] = [
  ["automatic", "Automatic"],
  ["local", "This device"],
  ["server", "Server"],
];

/** Renderer: shows who does, and lets the viewer choose. */
function renderModeSelect(onChoice: (choice: RenderSetting) => void): {
  element: HTMLElement;
  show(drawing: RenderStatus): void;
} {
  const options = RENDER_SETTINGS.map(([value, words]) => h("option", { value }, words));
  const select = h("select", { testId: "render-mode" }, ...options);
  select.setAttribute("aria-label", "Renderer");
  select.addEventListener("change", () => onChoice(select.value as RenderSetting));
  const words = h("span", {}, "Rendered by the server");
  const element = h("label", { className: "button glass render-mode" }, icon("screen"), words, select);
  return {
    element,
    show: ({ setting, mode, obstacle }) => {
      select.value = setting;
      select.dataset["mode"] = mode;
      element.title = obstacle ?? "Choose whether this device or the server renders the picture";
      options.forEach((option, index) => (option.disabled = RENDER_SETTINGS[index]?.[0] === "local" && obstacle !== null));
      words.textContent = mode === "local" ? "Rendered on this device" : "Rendered by the server";
    },
  };
}

function stateNotice(state: LiveState, hooks: MeetingViewHooks): HTMLElement[] {
  switch (state.kind) {
    case "live":
      return [];
    case "connecting":
    case "preparing":
    case "reconnecting":
    case "audio-only":
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

function statsLine(): { element: HTMLElement; show(news: LiveStats): void } {
  const fps = h("span", { testId: "fps" });
  fps.dataset["fps"] = fps.dataset["frames"] = "0";
  const element = h("p", { className: "stats glass", attributes: { "aria-hidden": "true" } }, fps);
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
function showPerformers(people: HTMLElement, performers: readonly Performer[], live: LiveView): void {
  const key = performers.map(({ id, name }) => `${id} ${name}`).join();
  if (people.dataset["key"] === key) return;
  people.dataset["key"] = key;
  people.replaceChildren(
    ...performers.map((performer) => {
      const chip = button(performer.name, () => live.lookAt(performer), { look: "glass" });
      chip.setAttribute("aria-label", `Look at ${performer.name}`);
      return chip;
    }),
  );
}

/** The server writes the link, with a token where one is needed, and this page the key; the address is this page's own. */
function inviteButton(joinUrl: () => string): HTMLElement {
  const invite = button("Copy invite link", () => void copy(), { look: "glass", icon: "link" });
  const label = invite.querySelector("span");
  const say = (words: string): void => {
    if (label) label.textContent = words;
    announce(words);
  };
  const copy = async (): Promise<void> => {
    const { search, hash } = new URL(joinUrl(), location.href);
    const link = `${location.origin}/${search}${hash}`;
    try {
      await navigator.clipboard.writeText(link);
      say("Copied");
    } catch {
      // only secure addresses may write to the clipboard; then people copy by hand
      prompt("Send this link to the people you want to invite:", link);
    }
    setTimeout(() => say("Copy invite link"), COPIED_MS);
  };
  return invite;
}

function controlsHelp(): HTMLElement[] {
  const lines: [string, string][] = usesTouch()
    ? [
        ["One finger", "look around"],
        ["Pinch", "zoom"],
        ["Two fingers", "pan"],
        ["Double tap", "reset view"],
      ]
    : [
        ["Drag", "look around"],
        ["Scroll", "zoom"],
        ["W A S D", "walk (Shift: faster)"],
        ["R", "reset view"],
        ["Enter", "go to the buttons"],
      ];
  return lines.map(([key, what]) => h("span", {}, h("kbd", {}, key), what));
}

