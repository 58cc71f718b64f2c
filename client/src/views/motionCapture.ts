/** Oneself, small, as the others see one; and motion capture on or off, its preview and its state. */

import { MotionCapture, type Tracking } from "../motion/motionCapture";
import { drawSkeleton } from "../landmarks/skeleton";
import type { LiveView } from "../drawing/live";
import { Problem, asProblem } from "../api/problem";
import type { Performer } from "../api/types";
import { announce, h } from "./dom";
import { learningControl, type LearningControl } from "./learning";
import { liveLookControl, type LiveLookControl } from "./liveLook";
import { animatablePeople, type AnimatablePerson } from "../enrolment/keypoints";
import { modelButtons, ownPerformers } from "./ownModels";
import { keyProblem } from "./sealedNote";
import { selfView } from "./selfView";
import { button, notice, type View } from "./shell";

const WORDS: Record<Tracking, string> = {
  starting: "Starting…",
  searching: "Nobody in view. Step back until your shoulders are visible.",
  disconnected: "Connecting to the meeting…",
  tracking: "Your movements are shown in the meeting",
};
const ONLY_MOVEMENTS = "Only your movements leave this device.";
const ONLY_SEALED = "Only your movements leave this device, sealed.";
const NO_OWN_MODEL = new Problem(
  "You have no model yet",
  "Create a model on the start page, then come back.",
);

interface MotionCaptureView extends View {
  toggle: HTMLButtonElement;
  camera(): MediaStream | null;
  /** Somebody has come or gone. */
  update(): void;
  /** The network has no room for pictures of oneself, or has it again. */
  setPoorNetwork(poor: boolean): void;
  /** Ask what becomes of the pictures that wait; resolves once that is said. */
  settle(): Promise<void>;
}

/**
 * A button that switches the camera on and off, and a panel for what it shows. While it is off, the
 * panel shows one's own model where the meeting's picture is of others.
 */
export function motionCaptureView(live: LiveView): MotionCaptureView {
  const toggle = button("Track my movements", () => (pressed() ? void settle().then(rest) : begin()), {
    look: "glass",
    icon: "camera",
    testId: "motion-capture",
  });
  toggle.title = "Animate your model with your camera";
  const element = h("section", {
    className: "self glass",
    hidden: true,
    testId: "self",
  });
  // what scrolls here turns no view
  for (const kind of ["pointerdown", "wheel"]) element.addEventListener(kind, (event) => event.stopPropagation());
  const pressed = (): boolean => toggle.getAttribute("aria-pressed") === "true";
  let capture: MotionCapture | null = null;
  let self: ReturnType<typeof selfView> | null = null;
  let look: LiveLookControl | null = null;
  let learning: LearningControl | null = null;
  let poorNetwork = false;
  /** Of one's own performer that is shown without a camera. */
  let restingId = "";

  const show = (on: boolean, ...children: Node[]): void => {
    toggle.setAttribute("aria-pressed", String(on));
    element.setAttribute("aria-label", on ? "Motion capture" : "You");
    element.hidden = children.length === 0;
    element.replaceChildren(...children);
  };

  const end = (): void => {
    look?.close();
    learning?.close();
    capture?.close();
    self?.close();
    look = learning = capture = self = null;
    restingId = "";
    delete element.dataset["tracking"];
    show(false);
  };

  const rest = (): void => {
    end();
    update();
  };

  const update = (): void => {
    const [me, ...others] = live.meeting.performers.filter(({ owner }) => owner === "own");
    // who is alone, or has several models, sees them all in the meeting's picture
    const id = me && others.length === 0 && live.meeting.performers.length > 1 ? me.id : "";
    if (pressed() || id === restingId) return;
    end();
    if (id === "") return;
    restingId = id;
    self = selfView(live, id);
    show(false, h("div", { className: "self-picture" }, self.element), h("p", { className: "self-detail" }, "As others see you"));
  };

  const showProblem = (problem: Problem): void => {
    end();
    show(true, notice(problem, button("Close", rest)));
  };

  const begin = (): void => {
    end();
    const keyless = live.sealing && keyProblem(live.sealing);
    if (keyless) return showProblem(new Problem("Your movements cannot be sealed", keyless));
    const mine = ownPerformers(live.meeting.performers);
    const [first] = mine;
    if (!first) return void bring();
    if (mine.length === 1) return captureAs(first);
    choose(mine.map((one) => ({ ...one, modelId: one.model_id })), captureAs);
  };

  const choose = <Choice extends { name: string; modelId: string }>(models: Choice[], onChoice: (one: Choice) => void): void =>
    show(true, statusLine("Which model is yours?"), modelButtons(live.api, models, onChoice));

  /** Stand in the meeting with a model that was made before. */
  const bring = async (): Promise<void> => {
    show(true, statusLine("Looking for your model…"));
    const standAs = async ({ modelId }: AnimatablePerson): Promise<void> => {
      const performer = await live.api.addPerformer(live.meeting.id, modelId);
      if (pressed()) captureAs(performer);
    };
    try {
      const models = (await animatablePeople(live.api)).filter(({ mine }) => mine);
      const [first] = models;
      if (!pressed()) return;
      if (!first) return showProblem(NO_OWN_MODEL);
      if (models.length === 1) return await standAs(first);
      choose(models, (one) => void standAs(one).catch((error: unknown) => showProblem(asProblem(error))));
    } catch (error) {
      showProblem(asProblem(error));
    }
  };

  const captureAs = ({ id, name, owner }: Pick<Performer, "id" | "name" | "owner">): void => {
    const status = statusLine(WORDS.starting);
    const canvas = h("canvas", { attributes: { "aria-hidden": "true" } });
    self = selfView(live, id);
    const animating = `Animating ${name}.`;
    const line = h("p", { className: "self-detail" }, `${animating} ${live.sealing ? ONLY_SEALED : ONLY_MOVEMENTS}`);
    capture = new MotionCapture(() => live.openMotionChannel(id), {
      onTracking: (tracking) => {
        element.dataset["tracking"] = tracking;
        for (const one of [look, learning]) if (one) one.element.hidden = tracking === "starting";
        if (tracking === "disconnected") learning?.lost();
        status.textContent = WORDS[tracking];
        announce(WORDS[tracking]);
      },
      onLandmarks: (seen) => drawSkeleton(canvas, seen),
      onProblem: showProblem,
    });
    const camera = h("div", { className: "self-camera" }, capture.video, canvas);
    // a lent model is nobody's likeness; and pictures are not sealed
    if (owner === "own" && !live.sealing) {
      look = liveLookControl(live, capture, (on) => (line.textContent = on ? animating : `${animating} ${ONLY_MOVEMENTS}`));
      look.element.hidden = true;
      look.setPoorNetwork(poorNetwork);
      learning = learningControl(live, id);
      learning.element.hidden = true;
    }
    const parts = [look, learning].flatMap((one) => (one ? [one.element] : []));
    show(true, h("div", { className: "self-picture" }, self.element, camera), status, line, ...parts);
    void capture.start();
  };

  toggle.setAttribute("aria-pressed", "false");
  update();
  const setPoorNetwork = (poor: boolean): void => {
    poorNetwork = poor;
    look?.setPoorNetwork(poor);
  };
  const settle = (): Promise<void> => learning?.settle() ?? Promise.resolve();
  return { element, toggle, update, setPoorNetwork, settle, close: end, camera: () => capture?.camera ?? null };
}

function statusLine(text: string): HTMLElement {
  return h("p", { className: "self-status", testId: "self-status" }, text);
}
