import { describe, expect, it } from "vitest";
import { SplatBudget } from "../../src/splats/budget";
import { HEADSET_STEPS, headsetRules, type HeadsetStep } from "../../src/xr/headsetSteps";
import { panelInFrontOf, ViewerRig, homePose, STANDING_EYES_M } from "../../src/xr/rig";
import { hitTest } from "../../src/xr/pointers";
import { column, eyeCamera, floorHit, headPose, quadHit, rayOf, yawOf, type Matrix } from "../../src/xr/space";
import { rotationMatrix } from "../../src/viewpoint/geometry";
import { passCamera } from "../../src/splats/camera";
import { homeOrbit, orbitCamera } from "../../src/viewpoint/viewpoint";
import { FRONT } from "../viewpoint/front";

/** A head at x, y, z that is turned to the left about y and then tilted up. */
function headAt(x: number, y: number, z: number, yaw = 0, tilt = 0): Matrix {
  const [s, c, st, ct] = [Math.sin(yaw), Math.cos(yaw), Math.sin(tilt), Math.cos(tilt)];
  return [c, 0, -s, 0, s * st, ct, c * st, 0, s * ct, -st, c * ct, 0, x, y, z, 1];
}

/** What WebXR gives for tangents of the half angles to the left, right, top and bottom. */
function projectionOf(left: number, right: number, top: number, bottom: number): Matrix {
  const matrix = new Array<number>(16).fill(0);
  matrix[0] = 2 / (left + right);
  matrix[5] = 2 / (top + bottom);
  matrix[8] = (right - left) / (left + right);
  matrix[9] = (top - bottom) / (top + bottom);
  matrix[11] = -1;
  return matrix;
}

/** Where a camera shows a place of the room, px. */
function shownAt(camera: ReturnType<typeof eyeCamera>, place: readonly number[]): number[] {
  const m = camera.worldToCamera;
  const [x = 0, y = 0, z = 0] = [0, 4, 8].map(
    (row) => (m[row + 3] ?? 0) + [0, 1, 2].reduce((sum, c) => sum + (m[row + c] ?? 0) * (place[c] ?? 0), 0),
  );
  return [(camera.focalPx[0] * x) / z + camera.centrePx[0], (camera.focalPx[1] * y) / z + camera.centrePx[1]];
}

const close = (values: readonly number[], digits = 5): unknown[] => values.map((value) => expect.closeTo(value, digits));

describe("eyeCamera", () => {
  it("shows what lies at an edge of the projection at that edge of the picture", () => {
    const camera = eyeCamera(headAt(0, 1.6, 2), projectionOf(1.2, 0.8, 0.9, 1.1), 800, 600);
    expect(shownAt(camera, [-1.2, 1.6, 1])).toEqual(close([0, 270], 3));
    expect(shownAt(camera, [0.8, 1.6, 1])).toEqual(close([800, 270], 3));
    expect(shownAt(camera, [0, 2.5, 1])).toEqual(close([480, 0], 3));
    expect(shownAt(camera, [0, 0.5, 1])).toEqual(close([480, 600], 3));
  });

  it("is the same camera as the page's for the same place and angle", () => {
    const pose = orbitCamera({ target: [0.3, 1, -0.2], azimuthRad: 0.7, elevationRad: 0.2, distanceM: 2 });
    const page = passCamera(pose, 1, 640, 480);
    const turn = rotationMatrix(pose.wxyz);
    const at = (r: number, c: number): number => turn[3 * r + c] ?? 0;
    const axis = (c: number, sign: number): number[] => [sign * at(0, c), sign * at(1, c), sign * at(2, c), 0];
    const matrix = [...axis(0, 1), ...axis(1, -1), ...axis(2, -1), ...pose.position, 1];
    const half = Math.tan(0.5);
    const eye = eyeCamera(matrix, projectionOf(half * (4 / 3), half * (4 / 3), half, half), 640, 480);
    expect([...eye.worldToCamera]).toEqual(close([...page.worldToCamera]));
    expect([...eye.focalPx, ...eye.centrePx]).toEqual(close([...page.focalPx, ...page.centrePx], 3));
    expect(headPose(matrix).position).toEqual(pose.position);
    const { wxyz } = headPose(matrix);
    const same = wxyz.reduce((sum, value, i) => sum + value * (pose.wxyz[i] ?? 0), 0);
    expect(Math.abs(same)).toBeCloseTo(1, 6);
  });

  it("tells heads in every direction, also upside down", () => {
    for (const yaw of [-3, -1.5, 0, 1.5, 3]) {
      for (const tilt of [-1.4, 0, 1.4, 3]) {
        const head = headAt(0, 1, 0, yaw, tilt);
        const rows = rotationMatrix(headPose(head).wxyz);
        expect([rows[2], rows[5], rows[8]]).toEqual(close(rayOf(head).along.map((value) => value), 5));
      }
    }
  });
});

describe("rays", () => {
  it("meet the floor within reach", () => {
    const down = rayOf(headAt(1, 1, 2, 0, -Math.PI / 4));
    expect(floorHit(down, 7)).toEqual(close([1, 0, 1]));
    expect(floorHit(down, 1)).toBeNull();
    expect(floorHit(rayOf(headAt(0, 1, 0)), 7)).toBeNull();
    expect(floorHit({ from: [0, -1, 0], along: [0, -1, 0] }, 7)).toBeNull();
  });

  it("meet a board where it is pointed at, and nothing beside or behind it", () => {
    const quad = { middle: [0, 1, -2], right: [0.5, 0, 0], up: [0, 0.25, 0] } as const;
    expect(quadHit({ from: [0.25, 1.125, 0], along: [0, 0, -1] }, quad)).toEqual({
      u: expect.closeTo(0.75, 6),
      v: expect.closeTo(0.25, 6),
      distanceM: expect.closeTo(2, 6),
    });
    expect(quadHit({ from: [0.6, 1, 0], along: [0, 0, -1] }, quad)).toBeNull();
    expect(quadHit({ from: [0, 1, -3], along: [0, 0, -1] }, quad)).toBeNull();
    expect(quadHit({ from: [0, 1, 0], along: [1, 0, 0] }, quad)).toBeNull();
  });

  it("press what is in front: a button, else the floor, and nothing through a disabled one", () => {
    const board = { middle: [0, 1, -1], right: [0.5, 0, 0], up: [0, 0.5, 0] } as const;
    const whole = { kind: "button", label: "All", x: 0, y: 0, width: 1024, height: 760 } as const;
    const act = { kind: "leave" } as const;
    const ray = { from: [0, 1.6, 0], along: [0, -Math.SQRT1_2, -Math.SQRT1_2] } as const;
    expect(hitTest(ray, { quad: board, items: [{ ...whole, action: act }] }).over).toMatchObject({ kind: "item" });
    expect(hitTest(ray, { quad: board, items: [{ ...whole, action: act, disabled: true }] }).over).toBeNull();
    expect(hitTest(ray, { quad: board, items: [] }).over).toEqual({ kind: "floor", at: close([0, 0, -1.6]) });
    expect(hitTest({ from: [0, 1, 0], along: [0, 1, 0] }, null).over).toBeNull();
  });
});

describe("ViewerRig", () => {
  const head = headAt(0.4, 1.2, -0.3, 0.5);

  it("puts whoever comes where a screen would show the room from, whichever way they stand at home", () => {
    const footing = new ViewerRig();
    for (const azimuth_rad of [0, 1.05, -2.5]) {
      const place = homePose({ ...FRONT, target: [2, 1.3, 1], azimuth_rad });
      const [x = 0, , z = 0] = orbitCamera(homeOrbit({ ...FRONT, target: [2, 1.3, 1], azimuth_rad }, 1)).position;
      footing.placeAt(head, place);
      const room = footing.toRoom(head);
      expect([...column(room, 3)]).toEqual(close([x, 1.2, z]));
      const { along } = rayOf(room);
      const towards = [2 - place.x, 1 - place.z];
      expect(along[0] * (towards[1] ?? 0) - along[2] * (towards[0] ?? 0)).toBeCloseTo(0, 5);
      expect(along[0] * (towards[0] ?? 0) + along[2] * (towards[1] ?? 0)).toBeGreaterThan(0);
    }
  });

  it("steps to a place, though not out of the room, and keeps its direction", () => {
    const footing = new ViewerRig();
    footing.placeAt(head, { x: 0, z: 2, yawRad: 0.3 });
    footing.teleport(head, [1, 0, -1], [0, 0]);
    expect([...column(footing.toRoom(head), 3)]).toEqual(close([1, 1.2, -1]));
    expect(yawOf(footing.toRoom(head))).toBeCloseTo(0.3, 5);
    footing.teleport(head, [30, 0, 40], [0, 0]);
    expect([...column(footing.toRoom(head), 3)]).toEqual(close([4.8, 1.2, 6.4]));
  });

  it("turns on the spot, and lifts whoever sits to the height of somebody who stands", () => {
    const footing = new ViewerRig();
    footing.placeAt(head, { x: 1, z: 2, yawRad: 0 });
    footing.snapTurn(head, Math.PI / 6);
    expect(yawOf(footing.toRoom(head))).toBeCloseTo(Math.PI / 6, 5);
    footing.setStanding(head, true);
    expect([...column(footing.toRoom(head), 3)]).toEqual(close([1, STANDING_EYES_M, 2]));
    footing.teleport(head, [0, 0, 0], [0, 0]);
    expect(column(footing.toRoom(head), 3)[1]).toBeCloseTo(STANDING_EYES_M, 5);
    footing.setStanding(head, false);
    expect(column(footing.toRoom(head), 3)[1]).toBeCloseTo(1.2, 5);
  });

  it("moves rays and boards with heads", () => {
    const footing = new ViewerRig();
    footing.placeAt(head, { x: -1, z: 0.5, yawRad: 2 });
    const board = panelInFrontOf(head, 0.75, 0.4, 0.6, 0.4);
    const there = footing.quadToRoom(board);
    const eye = column(footing.toRoom(head), 3);
    expect(Math.hypot(...there.middle.map((value, i) => value - (eye[i] ?? 0)))).toBeCloseTo(Math.hypot(0.75, 0.4), 5);
    // it faces the eyes, upright
    const towards = there.middle.map((value, i) => value - (eye[i] ?? 0));
    for (const edge of [there.right, there.up]) {
      expect(edge.reduce((sum, value, i) => sum + value * (towards[i] ?? 0), 0)).toBeCloseTo(0, 5);
    }
    expect(there.up[1]).toBeGreaterThan(0);
    const ray = footing.rayToRoom(rayOf(head));
    expect([...ray.along]).toEqual(close(rayOf(footing.toRoom(head)).along.map((value) => value)));
  });
});

describe("the budget of a headset", () => {
  const PACE = 1000 / 72;

  function run(budget: SplatBudget<HeadsetStep>, clock: { ms: number }, pictures: number, tookMs: number): number[] {
    const steps: number[] = [];
    for (let n = 0; n < pictures; n++) {
      clock.ms += tookMs;
      if (budget.observeAt(clock.ms)) steps.push(budget.step.splats);
    }
    return steps;
  }

  it("gives fewer splats while pictures come late, down to the fewest", () => {
    const budget = new SplatBudget(headsetRules(PACE));
    const clock = { ms: 1 };
    expect(run(budget, clock, 37, 1.5 * PACE)).toEqual([21_000]);
    expect(run(budget, clock, 36, 3 * PACE)).toEqual([10_000]);
    run(budget, clock, 1000, 3 * PACE);
    expect(budget.step).toBe(HEADSET_STEPS.at(-1));
  });

  it("gives more again after calm, and less often where that was a mistake", () => {
    const budget = new SplatBudget(headsetRules(PACE));
    const clock = { ms: 1 };
    run(budget, clock, 37, 2 * PACE);
    expect(budget.step.splats).toBe(21_000);
    expect(run(budget, clock, 36 * 5, PACE)).toEqual([]);
    expect(run(budget, clock, 36, PACE)).toEqual([30_000]);
    expect(run(budget, clock, 36, 2 * PACE)).toEqual([21_000]);
    expect(run(budget, clock, 36 * 11, PACE)).toEqual([]);
    expect(run(budget, clock, 36, PACE)).toEqual([30_000]);
  });

  it("does not mind a late picture now and then, nor a pause", () => {
    const budget = new SplatBudget(headsetRules(PACE));
    const clock = { ms: 1 };
    for (let n = 0; n < 50; n++) {
      run(budget, clock, 35, PACE);
      run(budget, clock, 1, 2 * PACE);
      run(budget, clock, 1, 5000);
    }
    expect(budget.step.splats).toBeGreaterThanOrEqual(30_000);
  });
});
