/** Oneself as the others will see one: one's newest model, turning slowly. */

import type { Api } from "../api/api";
import { Portrait } from "../splats/portrait";
import { SplatPass } from "../splats/pass";
import { h, prefersReducedMotion } from "./dom";

const SIZE = { width: 240, height: 320 };
const FRAME_MS = 66;
const TURN_S = 14;
const FIRST_RAD = 0.5;
const DISTANCE_M = 3.6;
const MIDDLE_M = 0.92;
const ELEVATION_RAD = 0.06;

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
      const portrait = new Portrait(pass, bytes);
      const pose = portrait.atRest;
      const target = [pose.pelvis[0] ?? 0, MIDDLE_M, pose.pelvis[2] ?? 0] as const;
      const drawAt = (azimuthRad: number): void =>
        portrait.draw(pose, { target, azimuthRad, elevationRad: ELEVATION_RAD, distanceM: DISTANCE_M }, SIZE);
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
