/** Where in the room a headset's space stands: its viewer's place, steps, turns, and height. */

import type { Vec3 } from "../viewpoint/geometry";
import type { Viewpoint as DefaultViewpoint } from "../api/types";
import { add, column, scale, unit, yawOf, type Matrix, type Quad, type Ray } from "./space";

/** Eyes of somebody who stands, m above the floor. */
export const STANDING_EYES_M = 1.6;
export const SNAP_RAD = Math.PI / 6;
/** So far from the middle of everybody one may step, m: as far as walking goes on a screen. */
const MAX_TELEPORT_M = 8;

export interface FloorPose {
  x: number;
  z: number;
  /** Which way one looks there, turned about y from -z. */
  yawRad: number;
}

/** The place of the first view on a screen: one's own, or in front of everybody; the head's height is the viewer's. */
export function homePose({ target: [x, , z], azimuth_rad: yawRad, elevation_rad: elevationRad, distance_m: distanceM }: DefaultViewpoint): FloorPose {
  const awayM = distanceM * Math.cos(elevationRad);
  return { x: x + awayM * Math.sin(yawRad), z: z + awayM * Math.cos(yawRad), yawRad };
}

/** A rigid motion from a headset's space (floor at y = 0) into the room. */
export class ViewerRig {
  private origin: Vec3 = [0, 0, 0];
  private yawRad = 0;
  private isStanding = false;

  /** Whether the viewer is shown the room from the height of somebody who stands. */
  get standing(): boolean {
    return this.isStanding;
  }

  /** `m` of the headset's space, in the room. */
  toRoom(m: Matrix): Float32Array {
    const out = new Float32Array(16);
    for (const c of [0, 1, 2, 3] as const) out.set(this.rotated(column(m, c)), 4 * c);
    out.set(add(column(out, 3), this.origin), 12);
    out[15] = 1;
    return out;
  }

  /** The same of a ray. */
  rayToRoom({ from, along }: Ray): Ray {
    return { from: add(this.rotated(from), this.origin), along: this.rotated(along) };
  }

  /** The same of a rectangle. */
  quadToRoom({ middle, right, up }: Quad): Quad {
    return { middle: add(this.rotated(middle), this.origin), right: this.rotated(right), up: this.rotated(up) };
  }

  /** Put somebody whose head is at `head` (in the headset's space) at a place of the room. */
  placeAt(head: Matrix, { x, z, yawRad }: FloorPose): void {
    this.yawRad = yawRad - yawOf(head);
    this.put(column(head, 3), x, z);
  }

  /** Step to a place on the floor, or as near to it as one may go from `middle`. */
  teleport(head: Matrix, [x, , z]: Vec3, [mx, mz]: readonly [number, number]): void {
    const away = Math.hypot(x - mx, z - mz);
    const share = Math.min(1, MAX_TELEPORT_M / Math.max(away, 1e-9));
    this.put(column(head, 3), mx + share * (x - mx), mz + share * (z - mz));
  }

  /** Turn on the spot; positive: to the left. */
  snapTurn(head: Matrix, radians: number): void {
    const [x, , z] = column(this.toRoom(head), 3);
    this.yawRad += radians;
    this.put(column(head, 3), x, z);
  }

  /** Lift whoever sits to the height of somebody who stands, or set them down again. */
  setStanding(head: Matrix, standing: boolean): void {
    this.isStanding = standing;
    const lift = standing ? Math.max(0, STANDING_EYES_M - column(head, 3)[1]) : 0;
    this.origin = [this.origin[0], lift, this.origin[2]];
  }

  private put(head: Vec3, x: number, z: number): void {
    const [hx, , hz] = this.rotated(head);
    this.origin = [x - hx, this.origin[1], z - hz];
  }

  private rotated([x, y, z]: Vec3): Vec3 {
    const [s, c] = [Math.sin(this.yawRad), Math.cos(this.yawRad)];
    return [c * x + s * z, y, c * z - s * x];
  }
}

/** A board before somebody's eyes: so far ahead and below, tilted back so that it faces them, m. */
export function panelInFrontOf(head: Matrix, aheadM: number, belowM: number, widthM: number, heightM: number): Quad {
  const yaw = yawOf(head);
  const ahead: Vec3 = [-Math.sin(yaw), 0, -Math.cos(yaw)];
  const right: Vec3 = [Math.cos(yaw), 0, -Math.sin(yaw)];
  const towards = unit([aheadM * ahead[0], -belowM, aheadM * ahead[2]]);
  const middle = add(add(column(head, 3), ahead, aheadM), [0, -belowM, 0]);
  const up = unit(add([0, 1, 0], towards, -towards[1]));
  return { middle, right: scale(right, 0.5 * widthM), up: scale(up, 0.5 * heightM) };
}
