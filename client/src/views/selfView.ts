/** Oneself in the meeting, small and as the others see one: one's performer in its present pose, from the front. */

import type { LiveView } from "../drawing/live";
import { Portrait } from "../splats/portrait";
import { SplatPass } from "../splats/pass";
import { performerCheck, type PosePacket } from "../transport/packets";
import { homeOrbit } from "../viewpoint/viewpoint";
import { h } from "./dom";

const SIZE = { width: 320, height: 240 };
const FRAME_MS = 66;
/** Share of the time that drawing may take: the camera's landmarks come first. */
const SHARE = 0.2;

/** Shows the performer `id` until it is closed; stays hidden where this browser can't draw them. */
export function selfView(live: LiveView, id: string): { element: HTMLCanvasElement; close(): void } {
  const element = h("canvas", {
    className: "self-view",
    hidden: true,
    testId: "self-view",
    attributes: { role: "img", "aria-label": "You, as the others see you" },
  });
  const check = performerCheck(id);
  let pass: SplatPass | null = null;
  let portrait: Portrait | null = null;
  let modelId = "";
  let dueMs = -Infinity;
  let closed = false;

  const load = async (wanted: string): Promise<void> => {
    modelId = wanted;
    // who has no splats, or no graphics for them, simply sees none
    const bytes = await live.api.splats(wanted).catch(() => null);
    if (closed || modelId !== wanted || bytes === null) return;
    try {
      pass ??= new SplatPass(element);
      portrait = new Portrait(pass, bytes);
    } catch {
      portrait = null;
    }
  };

  const show = (pose: PosePacket): void => {
    const performer = pose.check === check ? live.meeting.performers.find((one) => one.id === id) : undefined;
    if (!performer) return;
    if (performer.model_id !== modelId) void load(performer.model_id);
    const startMs = performance.now();
    if (!pass || !portrait || startMs < dueMs) return;
    portrait.draw({ ...pose, yawRad: performer.yaw_rad }, homeOrbit(performer.viewpoint, SIZE.width / SIZE.height), SIZE);
    pass.read(1); // waits for the card
    dueMs = startMs + Math.max(FRAME_MS, (performance.now() - startMs) / SHARE);
    element.hidden = false;
  };

  live.watchPoses(show);
  return {
    element,
    close: () => {
      closed = true;
      live.watchPoses(null);
      pass?.close();
    },
  };
}
