/** The file of what a solver has to know of people in general; capture/live/solver_constants.py tells its layout. */

import { HEAD_POINTS } from "../landmarks/head";
import { JOINT_COUNT, LANDMARKS, type SolvedBody, type SolverConstants } from "./body";
import type { Numbers } from "./rotations";

const [FEATURES, WIDTH, OUTPUTS] = [544, 512, 168];
const LAYERS = ["blocks.0.0", "blocks.0.1", "blocks.1.0", "blocks.1.1"].flatMap((name): [string, number][] => [
  [`${name}.linear.weight`, WIDTH * WIDTH],
  [`${name}.linear.bias`, WIDTH],
  [`${name}.norm.weight`, WIDTH],
  [`${name}.norm.bias`, WIDTH],
]);
/** Names and numbers of the lifter's weights, in the file's order. */
export const WEIGHTS: readonly (readonly [string, number])[] = [
  ["mean", FEATURES],
  ["deviation", FEATURES],
  ["first.weight", WIDTH * FEATURES],
  ["first.bias", WIDTH],
  ...LAYERS,
  ["last.weight", OUTPUTS * WIDTH],
  ["last.bias", OUTPUTS],
];
const PEOPLE_NUMBERS = 15 * JOINT_COUNT + 3 * (LANDMARKS + HEAD_POINTS.length);
export const CONSTANTS_BYTES = 4 * PEOPLE_NUMBERS + 2 * WEIGHTS.reduce((sum, [, count]) => sum + count, 0);

const BODY_VERSION = 1;
const KIND_BODY = 9;
const BODY_HEAD_BYTES = 8;
export const BODY_BYTES = BODY_HEAD_BYTES + 4 * 3 * (JOINT_COUNT + LANDMARKS);

/** Throws an Error for a file of another size. */
export function readConstants(file: ArrayBuffer): SolverConstants {
  if (file.byteLength !== CONSTANTS_BYTES) {
    throw new Error(`the solver's file must be ${CONSTANTS_BYTES} bytes long; got ${file.byteLength}; reload the page`);
  }
  const read = reader(file, 0);
  const [mean, axes, stiffness] = [read(3 * JOINT_COUNT), read(9 * JOINT_COUNT), read(3 * JOINT_COUNT)];
  const typicalLandmarks = read(3 * LANDMARKS);
  const headPoints = read(3 * HEAD_POINTS.length);
  const halves = new Uint16Array(file, 4 * PEOPLE_NUMBERS);
  const lifter = new Map<string, Float32Array>();
  let at = 0;
  for (const [name, count] of WEIGHTS) lifter.set(name, Float32Array.from(halves.subarray(at, (at += count)), fromHalf));
  return { mean, axes, stiffness, typicalLandmarks, headPoints, lifter };
}

/** The body in a packet of the server's; null where it is none (services/live/motion/body_packet.py). */
export function readBody(packet: ArrayBuffer): SolvedBody | null {
  const data = new DataView(packet);
  if (packet.byteLength !== BODY_BYTES || data.getUint8(0) !== BODY_VERSION || data.getUint8(1) !== KIND_BODY) return null;
  const read = reader(packet, BODY_HEAD_BYTES);
  return { yaw: data.getFloat32(4, true), rest: read(3 * JOINT_COUNT), landmarks: read(3 * LANDMARKS) };
}

/** Gives the next so many float32. */
function reader(bytes: ArrayBuffer, start: number): (count: number) => Numbers {
  let at = start;
  return (count) => Float64Array.from(new Float32Array(bytes, at, ((at += 4 * count), count)));
}

/** A number of IEEE 754 binary16. */
function fromHalf(bits: number): number {
  const [exponent, fraction] = [(bits >> 10) & 0x1f, bits & 0x3ff];
  const size = exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : (2 ** -14 * fraction) / 1024;
  return bits & 0x8000 ? -size : size;
}
