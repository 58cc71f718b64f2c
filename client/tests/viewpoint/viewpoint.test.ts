import { describe, expect, it } from "vitest";
import type { Quaternion, Vec3 } from "../../src/viewpoint/geometry";
import { FRONT } from "./front";
import { STILL, Viewpoint, homeOrbit, orbitCamera, type Orbit } from "../../src/viewpoint/viewpoint";

const HOME: Orbit = { target: [0, 0.9, 0], azimuthRad: 0, elevationRad: 0.1, distanceM: 3 };

function settle(view: Viewpoint, seconds = 3): void {
  for (let i = 0; i < seconds * 60; i++) view.step(1 / 60);
}

function rotate([w, x, y, z]: Quaternion, [a, b, c]: Vec3): Vec3 {
  const [tx, ty, tz] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [
    a + w * tx + y * tz - z * ty,
    b + w * ty + z * tx - x * tz,
    c + w * tz + x * ty - y * tx,
  ];
}

describe("orbitCamera", () => {
  // target, distance, azimuth, elevation -> position, quaternion, from the server's orbit_camera
  const fromServer: [Vec3, number, number, number, Vec3, Quaternion][] = [
    [[0, 0.9, 0], 3.2, 0, 0.08, [0, 1.155727, 3.1897655], [0.0399893, 0.9992001, 0, 0]],
    [
      [0.5, 1, -1], 2, Math.PI / 2, 0.3,
      [2.410673, 1.5910404, -1], [0.1056687, 0.6991667, 0.1056687, -0.6991667],
    ],
    [
      [0, 1, 0], 4, Math.PI - 0.2, -0.1,
      [0.7907072, 0.6006663, -3.9006813], [0.0049896, -0.0997087, 0.0497295, 0.9937607],
    ],
    [
      [0, 1, 0], 1.5, -2.2, 1.2,
      [-0.4394474, 2.3980586, -0.3198719], [0.2561196, 0.374369, -0.5032135, 0.7355452],
    ],
  ];
  it.each(fromServer)("agrees with the server at %j, %d m", (target, distanceM, a, e, at, wxyz) => {
    const camera = orbitCamera({ target, distanceM, azimuthRad: a, elevationRad: e });
    camera.position.forEach((value, axis) => expect(value).toBeCloseTo(at[axis] ?? NaN, 5));
    // a quaternion and its negative are the same rotation
    const dot = camera.wxyz.reduce((sum, value, i) => sum + value * (wxyz[i] ?? NaN), 0);
    expect(Math.abs(dot)).toBeCloseTo(1, 6);
  });

  it("looks along +z at the target, with +y down", () => {
    const orbit: Orbit = { target: [1, 0.8, 2], azimuthRad: 0.7, elevationRad: 0.4, distanceM: 2.5 };
    const { position, wxyz } = orbitCamera(orbit);
    const forward = rotate(wxyz, [0, 0, 1]);
    position.forEach((value, axis) =>
      expect(value + 2.5 * (forward[axis] ?? NaN)).toBeCloseTo(orbit.target[axis] ?? NaN, 6),
    );
    expect(rotate(wxyz, [0, 1, 0])[1]).toBeLessThan(0);
    expect(rotate(wxyz, [1, 0, 0])[1]).toBeCloseTo(0, 6);
  });
});

describe("Viewpoint", () => {
  it("glides to where it is sent, and then rests", () => {
    const view = new Viewpoint(HOME, true);
    expect(view.step(1 / 60)).toBe(false);
    view.turn(1, 0);
    expect(view.step(1 / 60)).toBe(true);
    expect(view.orbit.azimuthRad).toBeGreaterThan(0);
    expect(view.orbit.azimuthRad).toBeLessThan(0.5);
    settle(view);
    expect(view.orbit.azimuthRad).toBeCloseTo(1, 6);
    expect(view.step(1 / 60)).toBe(false);
  });

  it("moves at once for those who want no motion", () => {
    const view = new Viewpoint(HOME, false);
    view.turn(1, 0);
    view.step(1 / 60);
    expect(view.orbit.azimuthRad).toBe(1);
    view.fling(5, 5);
    view.step(1 / 60);
    expect(view.orbit.azimuthRad).toBe(1);
  });

  it("walks where it looks, faster when running, and stops when let go", () => {
    const [walking, running] = [new Viewpoint(HOME, true), new Viewpoint(HOME, true)];
    walking.steer({ ...STILL, forward: 1 });
    running.steer({ ...STILL, forward: 1, run: true });
    settle(walking, 1);
    settle(running, 1);
    expect(walking.orbit.target[2]).toBeLessThan(-0.8);
    expect(running.orbit.target[2]).toBeLessThan(1.8 * walking.orbit.target[2]);
    walking.steer(STILL);
    settle(walking);
    const before = walking.orbit;
    settle(walking, 1);
    expect(walking.orbit).toBe(before);
  });

  it("walks to its own right from every side", () => {
    const view = new Viewpoint({ ...HOME, azimuthRad: Math.PI / 2 }, false);
    view.steer({ ...STILL, right: 1 });
    settle(view, 1);
    // from +x, looking at -x, the right hand points to -z
    expect(view.orbit.target[0]).toBeCloseTo(0, 6);
    expect(view.orbit.target[2]).toBeLessThan(-1);
  });

  it("keeps the eye above the floor and within its limits, whatever is asked", () => {
    const view = new Viewpoint(HOME, true);
    view.zoom(1e-9);
    view.turn(0, -9);
    view.pan(0, -50);
    settle(view);
    expect(view.camera.position[1]).toBeGreaterThan(0.1);
    expect(view.orbit.distanceM).toBeCloseTo(0.6, 5);
    view.zoom(1e9);
    view.turn(0, -9);
    settle(view);
    expect(view.camera.position[1]).toBeGreaterThan(0.1);
    expect(view.orbit.distanceM).toBeCloseTo(12, 2);
    view.pan(1e6, 0);
    settle(view);
    expect(Math.hypot(view.orbit.target[0], view.orbit.target[2])).toBeLessThan(8.01);
  });

  it("comes back by the short way", () => {
    const view = new Viewpoint(HOME, true);
    view.turn(2 * Math.PI * 3 + 0.3, 0.2);
    settle(view);
    view.reset();
    settle(view);
    expect(view.orbit.azimuthRad).toBeCloseTo(6 * Math.PI, 5);
    expect(view.orbit.elevationRad).toBeCloseTo(0.1, 5);
  });

  it("follows a new first view only while nobody has moved", () => {
    const wider = { ...HOME, distanceM: 5 };
    const untouched = new Viewpoint(HOME, true);
    untouched.setHome(wider);
    settle(untouched);
    expect(untouched.orbit.distanceM).toBeCloseTo(5, 2);
    const moved = new Viewpoint(HOME, true);
    moved.turn(1, 0);
    moved.setHome(wider);
    settle(moved);
    expect(moved.orbit.distanceM).toBe(3);
    moved.reset();
    settle(moved);
    expect(moved.orbit.distanceM).toBeCloseTo(5, 2);
  });
});

describe("homeOrbit", () => {
  it("is the server's view where the window is wide enough for it", () => {
    const view = { ...FRONT, target: [1, 1.4, 2] as const, azimuth_rad: 0.7 };
    expect(homeOrbit(view, 1.6)).toEqual({ target: [1, 1.4, 2], azimuthRad: 0.7, elevationRad: 0.08, distanceM: 2.2 });
  });

  it("steps back for more people and for narrow windows", () => {
    expect(homeOrbit({ ...FRONT, width_m: 3.5 }, 1.6).distanceM).toBeCloseTo(3.54, 2); // as the server's
    expect(homeOrbit(FRONT, 0.46).distanceM).toBeCloseTo(3.16, 2);
    expect(homeOrbit({ ...FRONT, width_m: 0 }, 0.46).distanceM).toBe(2.2); // one's own place is where it is
  });

  it("shows one of several where the window is too narrow for them", () => {
    const narrow = { ...FRONT, azimuth_rad: 0.5, width_m: 0 };
    const several = { ...FRONT, width_m: 2.2, narrow };
    expect(homeOrbit(several, 1.65)).toEqual(homeOrbit({ ...several, narrow: null }, 1.65));
    expect(homeOrbit(several, 1.6)).toEqual(homeOrbit(narrow, 1.6));
  });
});
