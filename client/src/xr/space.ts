/**
 * From a headset's space into the room: WebXR's matrices (4 x 4, column by column; y up, eyes look
 * along -z) on one side, our cameras (OpenCV axes) on the other. Metres, radians. No DOM in here.
 */

import type { Quaternion, Vec3 } from "../viewpoint/geometry";
import type { PassCamera } from "../splats/camera";
import type { CameraPose } from "../viewpoint/viewpoint";

/** A rigid motion, or a projection: 16 numbers, column by column. */
export type Matrix = ArrayLike<number>;

/** Something that points: from where, and which way (unit length). */
export interface Ray {
  from: Vec3;
  along: Vec3;
}

/** A flat rectangle: its middle, and from there to its right and upper edges. */
export interface Quad {
  middle: Vec3;
  right: Vec3;
  up: Vec3;
}

export function add(a: Vec3, b: Vec3, times = 1): Vec3 {
  return [a[0] + times * b[0], a[1] + times * b[1], a[2] + times * b[2]];
}

export function scale(a: Vec3, factor: number): Vec3 {
  return [factor * a[0], factor * a[1], factor * a[2]];
}

export function dot(a: Vec3, b: Vec3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function cross(a: Vec3, b: Vec3): Vec3 {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function unit(a: Vec3): Vec3 {
  return scale(a, 1 / Math.max(Math.hypot(...a), 1e-9));
}

/** Column `c` of a rigid motion: its axes x, y, z, then where it puts the origin. */
export function column(m: Matrix, c: 0 | 1 | 2 | 3): Vec3 {
  return [m[4 * c] ?? 0, m[4 * c + 1] ?? 0, m[4 * c + 2] ?? 0];
}

/** Which way somebody looks whose head is at `m`, turned about y from -z. */
export function yawOf(m: Matrix): number {
  const [x, , z] = column(m, 2);
  return Math.atan2(x, z);
}

/** Where `m` points. */
export function rayOf(m: Matrix): Ray {
  return { from: column(m, 3), along: scale(column(m, 2), -1) };
}

/** The camera of an eye at `m` (in the room) that WebXR would draw by `projection`. */
export function eyeCamera(m: Matrix, projection: Matrix, width: number, height: number): PassCamera {
  const eye = column(m, 3);
  // OpenCV's y points down and its z forward, WebXR's up and back
  const axes = [column(m, 0), scale(column(m, 1), -1), scale(column(m, 2), -1)];
  const worldToCamera = Float32Array.from(axes.flatMap((axis) => [...axis, -dot(axis, eye)]));
  const of = (index: number): number => projection[index] ?? 0;
  return {
    worldToCamera,
    eye,
    focalPx: [0.5 * width * of(0), 0.5 * height * of(5)],
    centrePx: [0.5 * width * (1 - of(8)), 0.5 * height * (1 + of(9))],
    width,
    height,
  };
}

/** What the server is told of a head at `m`. */
export function headPose(m: Matrix): CameraPose {
  const [x, y, z] = [column(m, 0), scale(column(m, 1), -1), scale(column(m, 2), -1)];
  return { position: column(m, 3), wxyz: quaternionOf([x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]]) };
}

/** The unit quaternion wxyz of a rotation, row by row (Shepperd 1978: by its largest component). */
export function quaternionOf(rows: readonly number[]): Quaternion {
  const at = (r: number, c: number): number => rows[3 * r + c] ?? 0;
  const [a, b, c] = [at(0, 0), at(1, 1), at(2, 2)];
  const squares = [1 + a + b + c, 1 + a - b - c, 1 - a + b - c, 1 - a - b + c];
  const [w, x, y] = [at(2, 1) - at(1, 2), at(0, 2) - at(2, 0), at(1, 0) - at(0, 1)];
  const [xy, xz, yz] = [at(0, 1) + at(1, 0), at(0, 2) + at(2, 0), at(1, 2) + at(2, 1)];
  const largest = squares.indexOf(Math.max(...squares));
  const square = squares[largest] ?? 1;
  const rest: readonly Quaternion[] = [
    [square, w, x, y],
    [w, square, xy, xz],
    [x, xy, square, yz],
    [y, xz, yz, square],
  ];
  const norm = 0.5 / Math.sqrt(square);
  const [q0, q1, q2, q3] = rest[largest] ?? [1, 0, 0, 0];
  return [q0 * norm, q1 * norm, q2 * norm, q3 * norm];
}

/** Where a ray meets the floor, within `reachM` of its beginning; null: nowhere. */
export function floorHit({ from, along }: Ray, reachM: number): Vec3 | null {
  if (along[1] >= -1e-6 || from[1] <= 0) return null;
  const distance = -from[1] / along[1];
  if (distance > reachM) return null;
  return [from[0] + distance * along[0], 0, from[2] + distance * along[2]];
}

/** Where a ray meets a rectangle: u from left to right and v from top to bottom, 0 to 1; or null. */
export function quadHit({ from, along }: Ray, { middle, right, up }: Quad): { u: number; v: number; distanceM: number } | null {
  const normal = cross(right, up);
  const towards = dot(along, normal);
  if (Math.abs(towards) < 1e-9) return null;
  const distanceM = dot(add(middle, from, -1), normal) / towards;
  if (distanceM <= 0) return null;
  const off = add(add(from, along, distanceM), middle, -1);
  const [x, y] = [dot(off, right) / dot(right, right), dot(off, up) / dot(up, up)];
  if (Math.abs(x) > 1 || Math.abs(y) > 1) return null;
  return { u: 0.5 + 0.5 * x, v: 0.5 - 0.5 * y, distanceM };
}
