/** Improve me: in plain words what is filmed and learnt, a mark while the camera films, and a way back. */

import { sleep } from "../api/api";
import { FILM_S, Improvement, improvable, type Improvable, type ImproveState, type LeftBehind } from "../enrolment/improve";
import type { LiveView } from "../drawing/live";
import { Problem, asProblem } from "../api/problem";
import { progressInWords } from "../enrolment/progressWords";
import { closeCamera, openCamera, record, type Film } from "../capture/record";
import { announce, h, present } from "./dom";
import { button, notice, type View } from "./shell";

const GET_READY_S = 5;
const LEFT_KEY = "metanerf.films";
const WHAT_HAPPENS =
  "Films you for ten seconds and learns from it. The pictures are sent to the server, and go once learnt.";
const NOBODY = new Problem(
  "Nobody here is yours to improve",
  "Film yourself once on the first page; then come back, and get better here.",
);
const STILL_THERE = "The film is still on the server; it is deleted when you come back.";
const STEPS = { upload: "Sending the film", capture: "Finding you in it", train: "Making you look better" } as const;

/** A switch, and a panel that says what it does. `borrow` is the camera that is open already, if one is. */
export function improveMeView(live: LiveView, borrow: () => MediaStream | null): View & { toggle: HTMLButtonElement } {
  const toggle = button("Improve me", () => void (isOn() ? end() : begin()), {
    look: "glass",
    icon: "better",
    testId: "improve-me",
  });
  toggle.title = "Look better in this meeting: film yourself for a moment";
  toggle.setAttribute("aria-pressed", "false");
  const isOn = (): boolean => toggle.getAttribute("aria-pressed") === "true";
  const panel = improvePanel(toggle, () => end());
  const improvement = new Improvement(live.api, leftBehind, panel.show);
  let asked = 0;

  const begin = async (): Promise<void> => {
    // a film that is being taken back comes first
    if (improvement.state.kind === "stopping") return;
    const now = ++asked;
    panel.ask("Getting ready…", note(WHAT_HAPPENS));
    try {
      const mine = await improvable(live.api, live.meeting.performers);
      if (now !== asked) return;
      if (mine.length === 0) throw NOBODY;
      if (mine.length === 1) improve(mine[0] as Improvable);
      else panel.ask("Who are you?", ...mine.map((one) => button(one.name, () => improve(one))));
    } catch (error) {
      if (now === asked) panel.show({ kind: "failed", problem: asProblem(error), advice: [], left: false });
    }
  };

  const improve = ({ performerId, personId }: Improvable): void => {
    const currentModelId = (): string | null => live.meeting.performers.find(({ id }) => id === performerId)?.model_id ?? null;
    void improvement.start(personId, currentModelId, (onSecond, signal) => film(borrow(), panel.picture, onSecond, signal));
  };

  const end = (): void => {
    asked += 1;
    void improvement.takeBack();
  };

  void improvement.tidy();
  return { element: panel.element, toggle, close: () => void improvement.leave() };
}

/** What is done and how far it is; the switch shows whether it is on. */
function improvePanel(toggle: HTMLButtonElement, onEnd: () => void): {
  element: HTMLElement;
  /** Of oneself, while one is filmed. */
  picture: HTMLElement;
  ask(text: string, ...below: Node[]): void;
  show(state: ImproveState): void;
} {
  const words = h("p", { className: "self-words", testId: "improve-words" });
  const more = h("div", { className: "improve-more" });
  const picture = h("div", { className: "self-picture", hidden: true });
  // one button throughout, so that no news takes the focus from it
  const way = button("Stop", onEnd, { testId: "improve-end" });
  const element = h(
    "section",
    { className: "self improve glass", hidden: true, testId: "improve", attributes: { "aria-label": "Improve me" } },
    picture,
    words,
    more,
    way,
  );
  let shown = "off";

  const lay = (on: boolean, kind: string, below: Node[]): void => {
    if (kind === "off" && element.contains(document.activeElement)) toggle.focus();
    toggle.setAttribute("aria-pressed", String(on));
    toggle.classList.toggle("filming", kind === "filming");
    element.dataset["kind"] = kind;
    element.hidden = kind === "off";
    more.replaceChildren(...below);
    way.disabled = kind === "stopping";
    (way.querySelector("span") as HTMLElement).textContent = on ? "Stop" : "Close";
  };

  return {
    element,
    picture,
    ask: (text, ...below) => {
      words.textContent = text;
      lay(true, "asking", below);
    },
    show: (state) => {
      const kind = state.kind === "filming" && state.second < 0 ? "ready" : state.kind;
      const phase = state.kind === "working" ? state.step : kind;
      words.textContent = inWords(state);
      if (phase !== shown || state.kind !== "filming") lay(ON.includes(kind), kind, present(below(state)) as Node[]);
      // each step once, not each second; a notice tells itself
      if (phase !== shown && kind !== "failed" && kind !== "off") announce(kind === "ready" ? WHAT_HAPPENS : inWords(state));
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
): Promise<Film> {
  const stream = lent ? lent.clone() : await openCamera();
  try {
    signal.throwIfAborted();
    // where being seen is on, the camera's picture is on the stage already
    if (!lent) mirror(stream, picture);
    for (let second = -GET_READY_S; second < 0; second++) {
      onSecond(second);
      await sleep(1000, signal);
    }
    return await record(stream, FILM_S, onSecond, signal);
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

function inWords(state: ImproveState): string {
  switch (state.kind) {
    case "off":
      return "";
    case "filming":
      if (state.second === -Infinity) return "Starting the camera…";
      return state.second < 0 ? `Filming in ${-state.second}` : `Filming · ${Math.ceil(FILM_S - state.second)} s left`;
    case "working":
      return STEPS[state.step];
    case "stopping":
      return "Taking it back…";
    case "stopped":
      return state.left ? "Stopped" : "Stopped; nothing of the film is kept";
    case "better":
      return "You look better now";
    case "failed":
      return "That did not work";
  }
}

function below(state: ImproveState): (Node | null)[] {
  switch (state.kind) {
    case "off":
    case "stopping":
      return [];
    case "filming":
      return [note(WHAT_HAPPENS)];
    case "working":
      return [note(progressInWords({ ...state, status: "working" }))];
    case "stopped":
      return [
        state.learnt ? note("What was learnt of it so far stays.") : null,
        state.left ? note(STILL_THERE) : null,
      ];
    case "better":
      return state.advice.map(note);
    case "failed":
      return [notice(state.problem), ...state.advice.map(note), state.left ? note(STILL_THERE) : null];
  }
}

function note(text: string): HTMLElement {
  return h("p", { className: "self-note" }, text);
}

const leftBehind: LeftBehind = {
  get: () => JSON.parse(localStorage.getItem(LEFT_KEY) ?? "[]") as string[],
  set: (ids) => (ids.length ? localStorage.setItem(LEFT_KEY, JSON.stringify(ids)) : localStorage.removeItem(LEFT_KEY)),
};
