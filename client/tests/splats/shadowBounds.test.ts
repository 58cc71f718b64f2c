import { describe, expect, it } from "vitest";
import { passCamera } from "../../src/splats/camera";
import { shadowBounds, type Shadow } from "../../src/splats/room";
import { orbitCamera } from "../../src/viewpoint/viewpoint";

const SIZE = 400;
const FOV_Y_RAD = 1;
const camera = passCamera(
  orbitCamera({ target: [0, 0.9, 0], azimuthRad: 0.4, elevationRad: 0.2, distanceM: 4 }), FOV_Y_RAD, SIZE, SIZE,
);
const UNDER: Shadow = [0.1, -0.2, 0.22, 0.45];

function projected(x: number, z: number): [number, number] {
  const m = camera.worldToCamera;
  const row = (r: number): number => (m[4 * r] ?? 0) * x + (m[4 * r + 2] ?? 0) * z + (m[4 * r + 3] ?? 0);
  return [camera.centrePx[0] + (camera.focalPx[0] * row(0)) / row(2), camera.centrePx[1] + (camera.focalPx[1] * row(1)) / row(2)];
}

describe("shadowBounds", () => {
  it("hold all of the floor that a shadow darkens, and not much else", () => {
    const [left, top, right, bottom] = shadowBounds(camera, [UNDER]) ?? [0, 0, 0, 0];
    const [x, z, radius] = UNDER;
    for (let turn = 0; turn < 6.28; turn += 0.1) {
      const reach = Math.sqrt(12) * radius;
      const [u, v] = projected(x + reach * Math.cos(turn), z + reach * Math.sin(turn));
      expect(u).toBeGreaterThanOrEqual(left);
      expect(u).toBeLessThanOrEqual(right);
      expect(v).toBeGreaterThanOrEqual(top);
      expect(v).toBeLessThanOrEqual(bottom);
    }
    expect((right - left) * (bottom - top)).toBeLessThan(0.15 * SIZE * SIZE);
  });

  it("hold the shadows of everybody", () => {
    const [left = 0, , right = 0] = shadowBounds(camera, [UNDER, [1, 0, 0.22, 0.3]]) ?? [];
    const [alone = 0, , aloneTo = 0] = shadowBounds(camera, [UNDER]) ?? [];
    expect(right - left).toBeGreaterThan(aloneTo - alone + 50);
  });

  it("are the whole picture where a shadow reaches behind the camera", () => {
    const [x, , z] = camera.eye;
    expect(shadowBounds(camera, [[x, z, 0.22, 0.45]])).toEqual([0, 0, SIZE, SIZE]);
  });

  it("are none where nothing casts one, or it lies beside the picture", () => {
    expect(shadowBounds(camera, [])).toBeNull();
    expect(shadowBounds(camera, [[0, 0, 0.22, 0]])).toBeNull();
    const [x, , z] = camera.eye;
    const [ahead, aside] = [[-x, -z], [-z, x]] as const;
    const far: Shadow = [x + 0.3 * ahead[0] + 3 * aside[0], z + 0.3 * ahead[1] + 3 * aside[1], 0.22, 0.45];
    expect(shadowBounds(camera, [far])).toBeNull();
  });
});
