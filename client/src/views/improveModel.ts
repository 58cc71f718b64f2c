/** Improving one's model from a short clip: explanation, recording mark, progress and cancelling. */

import { CLIP_S, ModelImprovement, improvable, type Improvable, type ImproveState, type PendingDeletions } from "../enrolment/improve";
import type { LiveView } from "../drawing/live";
import { Problem, asProblem } from "../api/problem";
import { sleep } from "../api/until";
import { progressText } from "../enrolment/progressText";
import { closeCamera, openCamera, record, type RecordedClip } from "../capture/record";
import { announce, h, withoutEmpty } from "./dom";
import { modelButtons } from "./ownModels";
import { button, notice, type View } from "./shell";

const COUNTDOWN_S = 5;
const PENDING_KEY = "metanerf.films";
const WHAT_HAPPENS =
  "Records you for ten seconds and trains your model further. The clip is sent to the server and deleted after training.";
const NO_OWN_MODEL = new Problem(
  "None of your models is in this meeting",
  "Create a model on the start page, then come back to improve it.",
);
const STILL_THERE = "The clip is still on the server. It is deleted when you come back.";
const STEPS = { upload: "Uploading the clip", capture: "Detecting you in the clip", train: "Training your model" } as const;

/** A switch, and a panel that says what it does. `borrow` is the camera that is open already, if one is. */
export function improveModelView(live: LiveView, borrow: () => MediaStream | null): View & { toggle: HTMLButtonElement } {
  const toggle = button("Improve my model", () => void (isOn() ? end() : begin()), {
    look: "glass",
    icon: "better",
    testId: "improve-model",
  });
  toggle.title = "Record a short clip to improve your model";
  toggle.setAttribute("aria-pressed", "false");
  const isOn = (): boolean => toggle.getAttribute("aria-pressed") === "true";
  const panel = improvePanel(toggle, () => end());
  const improvement = new ModelImprovement(live.api, pendingDeletions, panel.show);
  let attempt = 0;

  const begin = async (): Promise<void> => {
    // a film that is being taken back comes first
    if (improvement.state.kind === "stopping") return;
    const now = ++attempt;
    panel.prompt("Preparing…", note(WHAT_HAPPENS));
    try {
      const mine = await improvable(live.api, live.meeting.performers);
      if (now !== attempt) return;
      if (mine.length === 0) throw NO_OWN_MODEL;
      if (mine.length === 1) improve(mine[0] as Improvable);
      else panel.prompt("Which model is yours?", modelButtons(live.api, mine, improve));
    } catch (error) {
      if (now === attempt) panel.show({ kind: "failed", problem: asProblem(error), advice: [], clipOnServer: false });
    }
  };

  const improve = ({ performerId, personId }: Improvable): void => {
    const currentModelId = (): string | null => live.meeting.performers.find(({ id }) => id === performerId)?.model_id ?? null;
    void improvement.start(personId, currentModelId, (onSecond, signal) => film(borrow(), panel.picture, onSecond, signal));
  };

  const end = (): void => {
    attempt += 1;
    void improvement.cancel();
  };

  void improvement.deletePending();
  return { element: panel.element, toggle, close: () => void improvement.leave() };
}

/** What is done and how far it is; the switch shows whether it is on. */
function improvePanel(toggle: HTMLButtonElement, onEnd: () => void): {
  element: HTMLElement;
  /** Of oneself, while one is filmed. */
  picture: HTMLElement;
  prompt(text: string, ...below: Node[]): void;
  show(state: ImproveState): void;
} {
  const words = h("p", { className: "self-status", testId: "improve-status" });
  const more = h("div", { className: "improve-details" });
  const picture = h("div", { className: "self-picture", hidden: true });
  // one button throughout, so that no news takes the focus from it
  const endButton = button("Stop", onEnd, { testId: "improve-end" });
  const element = h(
    "section",
    { className: "self improve glass", hidden: true, testId: "improve", attributes: { "aria-label": "Improve my model" } },
    picture,
    words,
    more,
    endButton,
  );
  let shown = "off";

  const render = (on: boolean, kind: string, below: Node[]): void => {
    if (kind === "off" && element.contains(document.activeElement)) toggle.focus();
    toggle.setAttribute("aria-pressed", String(on));
    toggle.classList.toggle("filming", kind === "filming");
    element.dataset["kind"] = kind;
    element.hidden = kind === "off";
    more.replaceChildren(...below);
    endButton.disabled = kind === "stopping";
    (endButton.querySelector("span") as HTMLElement).textContent = on ? "Stop" : "Close";
  };

  return {
    element,
    picture,
    prompt: (text, ...below) => {
      words.textContent = text;
      render(true, "asking", below);
    },
    show: (state) => {
      const kind = state.kind === "filming" && state.second < 0 ? "ready" : state.kind;
      const phase = state.kind === "working" ? state.step : kind;
      words.textContent = statusText(state);
      if (phase !== shown || state.kind !== "filming") render(ON.includes(kind), kind, withoutEmpty(details(state)) as Node[]);
      // each step once, not each second; a notice tells itself
      if (phase !== shown && kind !== "failed" && kind !== "off") announce(kind === "ready" ? WHAT_HAPPENS : statusText(state));
      shown = phase;
    },
  };
}

/** Time to read and to sit straight, then the film. A camera that was on before stays on; another goes off. */
async function film(
  lent: MediaStream | null,
  picture: HTMLElement,
  onSecond: (second: number) => void,
  signal: AbortSignal,
): Promise<RecordedClip> {
  const stream = lent ? lent.clone() : await openCamera();
  try {
    signal.throwIfAborted();
    // while motion capture is on, its own preview shows the camera
    if (!lent) mirror(stream, picture);
    for (let second = -COUNTDOWN_S; second < 0; second++) {
      onSecond(second);
      await sleep(1000, signal);
    }
    return await record(stream, CLIP_S, onSecond, signal);
  } finally {
    closeCamera(stream);
    picture.hidden = true;
    picture.replaceChildren();
  }
}

function mirror(stream: MediaStream, picture: HTMLElement): void {
  const video = h("video", { muted: true, playsInline: true, autoplay: true, attributes: { "aria-hidden": "true" } });
  video.srcObject = stream;
  picture.replaceChildren(video);
  picture.hidden = false;
}

const ON = ["ready", "filming", "working"];

function statusText(state: ImproveState): string {
  switch (state.kind) {
    case "off":
      return "";
    case "filming":
      if (state.second === -Infinity) return "Starting the camera…";
      return state.second < 0 ? `Recording starts in ${-state.second}` : `Recording · ${Math.ceil(CLIP_S - state.second)} s left`;
    case "working":
      return STEPS[state.step];
    case "stopping":
      return "Cancelling…";
    case "stopped":
      return state.clipOnServer ? "Cancelled" : "Cancelled. The clip has been deleted.";
    case "better":
      return "Your model has been improved";
    case "failed":
      return "Something went wrong";
  }
}

function details(state: ImproveState): (Node | null)[] {
  switch (state.kind) {
    case "off":
    case "stopping":
      return [];
    case "filming":
      return [note(WHAT_HAPPENS)];
    case "working":
      return [note(progressText({ ...state, status: "working" }))];
    case "stopped":
      return [
        state.improved ? note("Improvements trained so far are kept.") : null,
        state.clipOnServer ? note(STILL_THERE) : null,
      ];
    case "better":
      return state.advice.map(note);
    case "failed":
      return [notice(state.problem), ...state.advice.map(note), state.clipOnServer ? note(STILL_THERE) : null];
  }
}

function note(text: string): HTMLElement {
  return h("p", { className: "self-detail" }, text);
}

const pendingDeletions: PendingDeletions = {
  get: () => JSON.parse(localStorage.getItem(PENDING_KEY) ?? "[]") as string[],
  set: (ids) => (ids.length ? localStorage.setItem(PENDING_KEY, JSON.stringify(ids)) : localStorage.removeItem(PENDING_KEY)),
};
