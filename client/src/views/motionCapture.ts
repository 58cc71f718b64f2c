/** Motion capture on or off, a preview of the landmarks, and the state of the tracking. */

import { MotionCapture, type Tracking } from "../landmarks/motionCapture";
import { drawSkeleton } from "../landmarks/skeleton";
import type { LiveView } from "../drawing/live";
import { Problem } from "../api/problem";
import type { Performer } from "../api/types";
import { announce, h } from "./dom";
import { modelButtons, ownPerformers } from "./ownModels";
import { selfView } from "./selfView";
import { button, notice, type View } from "./shell";

const WORDS: Record<Tracking, string> = {
  starting: "Starting…",
  searching: "Nobody in view. Step back until your shoulders are visible.",
  disconnected: "Connecting to the meeting…",
  tracking: "Your movements are shown in the meeting",
};
const NO_OWN_MODEL = new Problem(
  "You have no model in this meeting",
  "Create a model on the start page, then come back.",
);

/** A button that switches the camera on and off, and a panel for what it shows. */
export function motionCaptureView(live: LiveView): View & { toggle: HTMLButtonElement; camera(): MediaStream | null } {
  const toggle = button("Track my movements", () => (element.hidden ? begin() : end()), {
    look: "glass",
    icon: "camera",
    testId: "motion-capture",
  });
  toggle.title = "Animate your model with your camera";
  const element = h("section", {
    className: "self glass",
    hidden: true,
    testId: "self",
    attributes: { "aria-label": "Motion capture" },
  });
  let capture: MotionCapture | null = null;
  let self: ReturnType<typeof selfView> | null = null;

  const show = (on: boolean, ...children: Node[]): void => {
    toggle.setAttribute("aria-pressed", String(on));
    element.hidden = !on;
    element.replaceChildren(...children);
  };

  const end = (): void => {
    capture?.close();
    self?.close();
    capture = self = null;
    show(false);
  };

  const showProblem = (problem: Problem): void => {
    end();
    show(true, notice(problem, button("Close", end)));
  };

  const begin = (): void => {
    const mine = ownPerformers(live.meeting.performers);
    const [first] = mine;
    if (!first) return showProblem(NO_OWN_MODEL);
    if (mine.length === 1) return captureAs(first);
    const models = mine.map((one) => ({ ...one, modelId: one.model_id }));
    show(true, statusLine("Which model is yours?"), modelButtons(live.api, models, captureAs));
  };

  const captureAs = ({ id, name }: Pick<Performer, "id" | "name">): void => {
    const status = statusLine(WORDS.starting);
    const canvas = h("canvas", { attributes: { "aria-hidden": "true" } });
    self = selfView(live, id);
    const line = h("p", { className: "self-detail" }, `Animating ${name}. Only your movements leave this device.`);
    capture = new MotionCapture(() => live.openKeypointsChannel(id), {
      onTracking: (tracking) => {
        element.dataset["tracking"] = tracking;
        status.textContent = WORDS[tracking];
        announce(WORDS[tracking]);
      },
      onLandmarks: (seen) => drawSkeleton(canvas, seen),
      onProblem: showProblem,
    });
    const camera = h("div", { className: "self-camera" }, capture.video, canvas);
    show(true, h("div", { className: "self-picture" }, self.element, camera), status, line);
    void capture.start();
  };

  toggle.setAttribute("aria-pressed", "false");
  return { element, toggle, close: end, camera: () => capture?.camera ?? null };
}

function statusLine(text: string): HTMLElement {
  return h("p", { className: "self-status", testId: "self-status" }, text);
}
