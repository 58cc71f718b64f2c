/** Oneself as the others will see one: one's newest model, turning slowly. */

import type { Api } from "../api/api";
import { packSplats, type PackedSplats } from "../splats/packed";
import { allocateOffsets } from "../splats/moved";
import { readSplats } from "../splats/file";
import { passCamera } from "../splats/camera";
import { SplatPass } from "../splats/pass";
import { contactShadows } from "../splats/room";
import { forwardKinematics, TRANSFORM } from "../splats/skeleton";
import { depthOrder, depthRows, depths, allocateOrder } from "../splats/sort";
import { FOV_Y_RAD, orbitCamera } from "../viewpoint/viewpoint";
import { h, prefersReducedMotion } from "./dom";

const SIZE = { width: 240, height: 320 };
const FRAME_MS = 66;
const TURN_S = 14;
const FIRST_RAD = 0.5;
const DISTANCE_M = 3.6;
const MIDDLE_M = 0.92;

export function selfPreview(api: Api): { element: HTMLElement; open(): Promise<void>; close(): void } {
  const canvas = h("canvas", { testId: "check-model", attributes: { role: "img", "aria-label": "You, as the others see you" } });
  const element = h("div", { className: "device-picture", hidden: true }, canvas);
  let turning: ReturnType<typeof setInterval> | undefined;
  let pass: SplatPass | null = null;
  let asked = 0;

  const close = (): void => {
    asked += 1;
    clearInterval(turning);
    element.hidden = true;
  };
  const open = async (): Promise<void> => {
    close();
    const now = asked;
    // who has no model, or may not ask for it, or has no graphics for it, simply sees none
    const bytes = await newestSplats(api).catch(() => null);
    if (now !== asked || bytes === null) return;
    try {
      pass ??= new SplatPass(canvas);
      const drawAt = restPoseRenderer(pass, packSplats([readSplats(bytes)]));
      const startMs = performance.now();
      drawAt(FIRST_RAD);
      element.hidden = false;
      if (prefersReducedMotion()) return;
      turning = setInterval(() => drawAt(FIRST_RAD + ((performance.now() - startMs) * 2 * Math.PI) / (TURN_S * 1000)), FRAME_MS);
    } catch {
      close();
    }
  };
  return { element, open, close };
}

async function newestSplats(api: Api): Promise<ArrayBuffer | null> {
  const [people, models] = await Promise.all([api.people(), api.models()]);
  const mine = new Set(people.filter((person) => person.mine).map(({ id }) => id));
  const model = models.filter(({ person_id }) => mine.has(person_id)).at(-1);
  return model ? api.splats(model.id) : null;
}

/** Draws somebody at rest, seen from an azimuth (rad). */
function restPoseRenderer(pass: SplatPass, cast: PackedSplats): (azimuthRad: number) => void {
  const [person] = cast.people;
  const transforms = new Float32Array(TRANSFORM * cast.joints);
  if (!person) return () => undefined;
  const pelvis = [...person.restJoints.slice(0, 3)];
  const turns = person.parents.length;
  forwardKinematics(person, pelvis, Array.from({ length: 4 * turns }, (_, i) => (i % 4 === 0 ? 1 : 0)), transforms);
  const shadows = contactShadows(person, transforms, 0);
  const offsets = allocateOffsets(cast.moved);
  pass.setSplats(cast);
  const depth = new Float32Array(cast.count);
  const order = allocateOrder(cast.count);
  return (azimuthRad) => {
    const orbit = { target: [pelvis[0] ?? 0, MIDDLE_M, pelvis[2] ?? 0] as const, azimuthRad, elevationRad: 0.06, distanceM: DISTANCE_M };
    const camera = passCamera(orbitCamera(orbit), FOV_Y_RAD, SIZE.width, SIZE.height);
    depths(cast.skinned, depthRows(transforms, camera.worldToCamera), depth);
    const count = depthOrder(depth, order);
    // a fresh view of the same numbers: the pass uploads an order that it does not know yet
    const shown = { transforms, offsets, shadows, order: order.slice(), count, growth: [1], yawsRad: [0] };
    pass.draw({ camera, ...shown, hideUnseen: false });
  };
}
