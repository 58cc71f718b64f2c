/**
 * Where the viewer stands and looks: orbit, zoom and walk with inertia. No DOM in here.
 *
 * World: metres, right-handed, y up, floor at y = 0. Azimuth 0 looks from +z, +pi/2 from +x;
 * elevation is positive above the target. Cameras have OpenCV axes: x right, y down, z forward.
 */

import type { Quaternion, Vec3 } from "./geometry";
import type { Viewpoint as DefaultViewpoint } from "../api/types";

export const FOV_Y_RAD = 0.6;
const ELEVATION_LIMITS_RAD = [-0.35, 1.35] as const;
const DISTANCE_LIMITS_M = [0.6, 12] as const;
const TARGET_HEIGHT_LIMITS_M = [0.1, 2.4] as const;
const MAX_DISTANCE_FROM_HOME_M = 8;
const LOWEST_EYE_M = 0.12;
const SETTLE_S = 0.09;
const GLIDE_S = 0.16;
const WALK_M_PER_S = 1.4;
const TURN_RAD_PER_S = 1.5;
const ZOOM_PER_S = 1.8;
const RUN = 2.5;
/** Below these nobody sees a change: the picture rests and nothing needs to be sent. */
const REST_RAD = 1e-4;
const REST_M = 2e-4;

export interface Orbit {
  target: Vec3;
  azimuthRad: number;
  elevationRad: number;
  distanceM: number;
}

export interface CameraPose {
  position: Vec3;
  wxyz: Quaternion;
}

/** Held keys, each -1, 0 or 1; `run` walks faster. */
export interface Steering {
  forward: number;
  right: number;
  turn: number;
  zoom: number;
  run: boolean;
}

export const STILL: Steering = { forward: 0, right: 0, turn: 0, zoom: 0, run: false };

/** `view`, or what the server says that a window of this aspect shows instead, too narrow for all of it. */
export function fittedView(view: DefaultViewpoint, aspect: number): DefaultViewpoint {
  return view.narrow && fittingM(view, aspect) > view.distance_m ? view.narrow : view;
}

/** The first view, as the server says; from so far away that a window of this aspect shows everybody. */
export function homeOrbit(home: DefaultViewpoint, aspect: number): Orbit {
  const view = fittedView(home, aspect);
  const distanceM = clamp(Math.max(view.distance_m, fittingM(view, aspect)), DISTANCE_LIMITS_M);
  return { target: view.target, azimuthRad: view.azimuth_rad, elevationRad: view.elevation_rad, distanceM };
}

/** From how far away a picture of this aspect holds the view's width. */
function fittingM(view: DefaultViewpoint, aspect: number): number {
  return view.width_m / (2 * Math.tan(FOV_Y_RAD / 2) * Math.max(aspect, 0.1));
}

/** The camera that `orbit` describes. */
export function orbitCamera(orbit: Orbit): CameraPose {
  const { azimuthRad: a, elevationRad: e, distanceM: d, target } = orbit;
  const position: Vec3 = [
    target[0] + d * Math.sin(a) * Math.cos(e),
    target[1] + d * Math.sin(e),
    target[2] + d * Math.cos(a) * Math.cos(e),
  ];
  // turn by pi about x takes OpenCV's axes (y down, z forward) to y up and z back; then tilt, turn
  const tilt: Quaternion = [Math.cos(-e / 2), Math.sin(-e / 2), 0, 0];
  const turn: Quaternion = [Math.cos(a / 2), 0, Math.sin(a / 2), 0];
  return { position, wxyz: multiply(multiply(turn, tilt), [0, 1, 0, 0]) };
}

export class Viewpoint {
  private now: Orbit;
  private goal: Orbit;
  private speed = { forward: 0, right: 0, turn: 0, zoom: 0 };
  private steering: Steering = STILL;

  /** With `inertia` false every move is immediate, as people ask for who are made ill by motion. */
  constructor(
    private home: Orbit,
    private readonly inertia: boolean,
  ) {
    this.now = this.goal = home;
  }

  get orbit(): Orbit {
    return this.now;
  }

  get camera(): CameraPose {
    return orbitCamera(this.now);
  }

  /** Turn around the target; positive azimuth moves the viewer to their right. */
  turn(azimuthRad: number, elevationRad: number): void {
    this.aim({
      azimuthRad: this.goal.azimuthRad + azimuthRad,
      elevationRad: this.goal.elevationRad + elevationRad,
    });
  }

  /** Let go of a drag at this speed (rad/s): the view glides on and settles. */
  fling(azimuthPerS: number, elevationPerS: number): void {
    if (this.inertia) this.turn(azimuthPerS * GLIDE_S, elevationPerS * GLIDE_S);
  }

  /** Multiply the distance; below 1 comes nearer. */
  zoom(factor: number): void {
    this.aim({ distanceM: this.goal.distanceM * factor });
  }

  /** Slide sideways and up by metres at the target's distance. */
  pan(rightM: number, upM: number): void {
    const [x, y, z] = this.goal.target;
    const { right } = headings(this.now.azimuthRad);
    this.aim({ target: [x + right[0] * rightM, y + upM, z + right[1] * rightM] });
  }

  steer(steering: Steering): void {
    this.steering = steering;
  }

  /** Go to another view; by the short way round. */
  goTo(orbit: Orbit): void {
    this.aim(this.turnedLike(orbit));
  }

  /** Back to the first view. */
  reset(): void {
    this.home = this.turnedLike(this.home);
    this.aim(this.home);
  }

  /** A new first view (people came or the window changed); a view still at the old one follows. */
  setHome(home: Orbit): void {
    const untouched = near(this.goal, this.home);
    this.home = home;
    if (untouched) this.reset();
  }

  /** Advance by `seconds`; says whether the view moved. */
  step(seconds: number): boolean {
    const dt = Math.min(seconds, 0.1);
    this.applySteering(dt);
    if (near(this.now, this.goal)) {
      const moved = this.now !== this.goal;
      this.now = this.goal;
      return moved;
    }
    const share = this.inertia ? 1 - Math.exp(-dt / SETTLE_S) : 1;
    this.now = blend(this.now, this.goal, share);
    return true;
  }

  /** Held keys speed up and slow down softly. */
  private applySteering(dt: number): void {
    const run = this.steering.run ? RUN : 1;
    const share = this.inertia ? 1 - Math.exp(-dt / SETTLE_S) : 1;
    for (const way of ["forward", "right", "turn", "zoom"] as const) {
      const wanted = this.steering[way] * run;
      this.speed[way] += (wanted - this.speed[way]) * share;
      if (wanted === 0 && Math.abs(this.speed[way]) < 1e-3) this.speed[way] = 0;
    }
    const { forward, right, turn, zoom } = this.speed;
    if (forward || right) {
      const ways = headings(this.goal.azimuthRad);
      const [x, y, z] = this.goal.target;
      const step = WALK_M_PER_S * dt;
      this.aim({
        target: [
          x + (ways.forward[0] * forward + ways.right[0] * right) * step,
          y,
          z + (ways.forward[1] * forward + ways.right[1] * right) * step,
        ],
      });
    }
    if (turn) this.turn(turn * TURN_RAD_PER_S * dt, 0);
    if (zoom) this.zoom(ZOOM_PER_S ** (-zoom * dt));
  }

  /** The same view, told with the whole turns that the viewer has made. */
  private turnedLike(orbit: Orbit): Orbit {
    const turns = Math.round((this.goal.azimuthRad - orbit.azimuthRad) / (2 * Math.PI));
    return { ...orbit, azimuthRad: orbit.azimuthRad + turns * 2 * Math.PI };
  }

  private aim(change: Partial<Orbit>): void {
    this.goal = limited({ ...this.goal, ...change }, this.home.target);
  }
}

/** Ground directions (x, z) of a viewer at `azimuthRad`. */
function headings(azimuthRad: number): { forward: [number, number]; right: [number, number] } {
  const [s, c] = [Math.sin(azimuthRad), Math.cos(azimuthRad)];
  return { forward: [-s, -c], right: [c, -s] };
}

function limited(orbit: Orbit, middle: Vec3): Orbit {
  let [x, , z] = orbit.target;
  const [dx, dz] = [x - middle[0], z - middle[2]];
  const away = Math.hypot(dx, dz);
  if (away > MAX_DISTANCE_FROM_HOME_M) {
    x = middle[0] + (dx * MAX_DISTANCE_FROM_HOME_M) / away;
    z = middle[2] + (dz * MAX_DISTANCE_FROM_HOME_M) / away;
  }
  const y = clamp(orbit.target[1], TARGET_HEIGHT_LIMITS_M);
  const distanceM = clamp(orbit.distanceM, DISTANCE_LIMITS_M);
  // the eye stays above the floor
  const lowest = Math.asin(clamp((LOWEST_EYE_M - y) / distanceM, [-1, 1]));
  const [low, high] = ELEVATION_LIMITS_RAD;
  const elevationRad = clamp(orbit.elevationRad, [Math.max(low, lowest), high]);
  return { target: [x, y, z], azimuthRad: orbit.azimuthRad, elevationRad, distanceM };
}

function blend(a: Orbit, b: Orbit, share: number): Orbit {
  const mix = (from: number, to: number): number => from + (to - from) * share;
  return {
    target: [
      mix(a.target[0], b.target[0]),
      mix(a.target[1], b.target[1]),
      mix(a.target[2], b.target[2]),
    ],
    azimuthRad: mix(a.azimuthRad, b.azimuthRad),
    elevationRad: mix(a.elevationRad, b.elevationRad),
    // distances are felt as ratios
    distanceM: Math.exp(mix(Math.log(a.distanceM), Math.log(b.distanceM))),
  };
}

function near(a: Orbit, b: Orbit): boolean {
  return (
    Math.abs(a.azimuthRad - b.azimuthRad) < REST_RAD &&
    Math.abs(a.elevationRad - b.elevationRad) < REST_RAD &&
    Math.abs(a.distanceM - b.distanceM) < REST_M &&
    a.target.every((value, axis) => Math.abs(value - (b.target[axis] ?? value)) < REST_M)
  );
}

function multiply(a: Quaternion, b: Quaternion): Quaternion {
  return [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
  ];
}

function clamp(value: number, [low, high]: readonly [number, number]): number {
  return Math.min(high, Math.max(low, value));
}
