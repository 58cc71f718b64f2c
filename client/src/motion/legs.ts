/** Legs that reach where feet are held: two bones, solved exactly; the server's twin is services/live/motion/foot_locking_kernels.py. */

import { JOINT_COUNT, LEFT, RIGHT, placeJoints } from "./body";
import {
  dot, lengthOf, multiply, multiplyTransposed, rotationBetween, rotationBy, type Numbers,
} from "./rotations"; // prettier-ignore

export const LEGS = [LEFT, RIGHT] as const;
/** A leg is never stretched further: a straight knee has no way to bend. */
const REACH = 0.999;

/** An ankle's place, m, and the foot's rotation in the room. */
export interface FootPlace {
  position: Numbers;
  rotation: Numbers;
}

const rotations = new Float64Array(9 * JOINT_COUNT);
const places = new Float64Array(3 * JOINT_COUNT);

/** Bend both legs of `local` to their ankles. Returns how far the pelvis sinks where one falls short, m. */
export function reachWith(local: Numbers, pelvis: Numbers, rest: Numbers, feet: readonly FootPlace[]): number {
  placeJoints(local, pelvis, rest, rotations, places);
  let sink = 0;
  LEGS.forEach(({ hip, knee, ankle }, side) => {
    const longest = REACH * (apart(rest, knee, hip) + apart(rest, ankle, knee));
    const [x, y, z] = feet[side]!.position as unknown as [number, number, number];
    const across = (x - places[3 * hip]!) ** 2 + (z - places[3 * hip + 2]!) ** 2;
    const room = Math.sqrt(Math.max(longest * longest - across, 0));
    sink = Math.min(sink, room + y - places[3 * hip + 1]!);
  });
  for (let k = 0; k < JOINT_COUNT; k++) places[3 * k + 1]! += sink;
  const [thigh, shin] = [new Float64Array(9), new Float64Array(9)];
  LEGS.forEach(({ hip, knee, ankle }, side) => {
    const { position, rotation } = feet[side]!;
    const forwards = [rotations[9 * hip + 2]!, rotations[9 * hip + 5]!, rotations[9 * hip + 8]!];
    const [upper, lower] = bend(place(hip), place(knee), place(ankle), forwards, position);
    multiply(upper, 0, rotations, 9 * hip, thigh);
    multiply(lower, 0, rotations, 9 * knee, shin);
    multiplyTransposed(rotations, 0, thigh, 0, local, 9 * hip);
    multiplyTransposed(thigh, 0, shin, 0, local, 9 * knee);
    multiplyTransposed(shin, 0, rotation, 0, local, 9 * ankle);
  });
  return sink;
}

/** The rotation about the vertical alone that faces the same way. */
export function level(rotation: Numbers): Numbers {
  return rotationBy(0, Math.atan2(rotation[2]!, rotation[8]!), 0);
}

/** The rotations of thigh and shin that bring the foot to `ankle`, as far as the leg reaches. */
function bend(hip: Numbers, knee: Numbers, foot: Numbers, forwards: readonly number[], ankle: Numbers): [Numbers, Numbers] {
  const [thigh, shin] = [minus(knee, hip), minus(foot, knee)];
  const [reach, line] = [minus(ankle, hip), minus(foot, hip)];
  const [upper, lower] = [lengthOf(thigh), lengthOf(shin)];
  const distance = Math.min(Math.max(lengthOf(reach), 1e-6), REACH * (upper + lower));
  const share = (upper * upper - lower * lower + distance * distance) / (2 * distance);
  scale(reach, 1 / Math.max(lengthOf(reach), 1e-9));
  scale(line, 1 / Math.max(lengthOf(line), 1e-9));
  // a nearly straight knee hardly says where it bends to: forwards
  const along = dot(thigh, line);
  const pole = thigh.map((value, c) => value - along * line[c]! + 0.1 * upper * forwards[c]!);
  const inReach = dot(pole, reach);
  for (let c = 0; c < 3; c++) pole[c]! -= inReach * reach[c]!;
  scale(pole, Math.sqrt(Math.max(upper * upper - share * share, 0)) / Math.max(lengthOf(pole), 1e-9));
  const newThigh = pole.map((value, c) => share * reach[c]! + value);
  const newShin = newThigh.map((value, c) => distance * reach[c]! - value);
  return [rotationBetween(thigh, newThigh), rotationBetween(shin, newShin)];
}

function place(joint: number): Numbers {
  return places.subarray(3 * joint, 3 * joint + 3);
}

function apart(rest: Numbers, a: number, b: number): number {
  return lengthOf([0, 1, 2].map((c) => rest[3 * a + c]! - rest[3 * b + c]!));
}

function minus(a: Numbers, b: Numbers): Numbers {
  return Float64Array.from(a, (value, c) => value - b[c]!);
}

function scale(vector: Numbers, by: number): void {
  for (let c = 0; c < 3; c++) vector[c]! *= by;
}
