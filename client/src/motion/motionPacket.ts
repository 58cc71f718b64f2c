/**
 * The `motion` packet: what was solved of one picture, 278 bytes, 360 while live look is on. Little endian;
 * services/live/motion/motion_packet.py tells what each byte holds, and tests hold both to the same bytes.
 */

import { HEAD, JOINT_COUNT, LEFT, NECK, RIGHT } from "./body";
import type { SolvedMotion } from "./motionSolver";
import { writeQuaternion, type Numbers } from "./rotations";

export const MOTION_BYTES = 278;
export const LONGEST_MOTION_BYTES = 360;
export const VERSION = 1;
export const KIND_MOTION = 8;
/** The highest bit of the header's u16; the others hold the picture's age. */
export const LIVE_LOOK = 0x8000;
const REACH = Math.SQRT1_2;
export const ROTATION_STEPS = 2 ** 15 - 1;
export const ROTATION_BYTES = 6;
export const TURN_STEPS = 127;
export const ROTATIONS_AT = 44;
export const TURNS_AT = ROTATIONS_AT + ROTATION_BYTES * JOINT_COUNT;
export const EXPRESSION_AT = TURNS_AT + 3 * JOINT_COUNT;
/** Joints that stand on the floor and look level where they are shown: before the camera they did not. */
const SEEN_JOINTS = [
  0, LEFT.hip, LEFT.knee, LEFT.ankle, LEFT.foot, RIGHT.hip, RIGHT.knee, RIGHT.ankle, RIGHT.foot, NECK, HEAD,
] as const; // prettier-ignore

/** `liveLook`: whether pictures travel with the motion. Number and age are told by `stampMotion`, as it leaves. */
export function encodeMotion(motion: SolvedMotion, liveLook: boolean): ArrayBuffer {
  const bytes = new ArrayBuffer(liveLook ? LONGEST_MOTION_BYTES : MOTION_BYTES);
  const data = new DataView(bytes);
  data.setUint8(0, VERSION);
  data.setUint8(1, KIND_MOTION);
  data.setUint16(2, liveLook ? LIVE_LOOK : 0, true);
  data.setFloat64(8, motion.timeMs, true);
  const scale = Math.fround(motion.ahead.reduce((most, value) => Math.max(most, Math.abs(value)), 0));
  [...motion.now.root, ...motion.aheadRoot, scale].forEach((value, i) => data.setFloat32(16 + 4 * i, value, true));
  for (let k = 0; k < JOINT_COUNT; k++) writeRotation(data, ROTATIONS_AT + ROTATION_BYTES * k, motion.now.local, k);
  motion.ahead.forEach((value, i) => {
    const level = Math.floor((TURN_STEPS * value) / (scale || 1) + 0.5);
    data.setInt8(TURNS_AT + i, Math.min(Math.max(level, -TURN_STEPS), TURN_STEPS));
  });
  motion.expression.forEach((share, i) => {
    data.setUint8(EXPRESSION_AT + i, Math.floor(255 * Math.min(Math.max(share, 0), 1) + 0.5));
  });
  data.setUint8(MOTION_BYTES - 1, (motion.locked[0] ? 1 : 0) | (motion.locked[1] ? 2 : 0));
  if (!liveLook) return bytes;
  data.setUint16(MOTION_BYTES, motion.width, true);
  data.setUint16(MOTION_BYTES + 2, motion.height, true);
  motion.seen.root.forEach((value, i) => data.setFloat32(MOTION_BYTES + 4 + 4 * i, value, true));
  SEEN_JOINTS.forEach((k, i) => writeRotation(data, MOTION_BYTES + 16 + ROTATION_BYTES * i, motion.seen.local, k));
  return bytes;
}

/** Number a packet, and tell how long ago its picture was taken. */
export function stampMotion(packet: ArrayBuffer, sequence: number, ageMs: number): void {
  const data = new DataView(packet);
  const age = Math.min(Math.max(Math.round(ageMs), 0), LIVE_LOOK - 1);
  data.setUint16(2, (data.getUint16(2, true) & LIVE_LOOK) | age, true);
  data.setUint32(4, sequence, true);
}

/** The same packet, of a moment in which live look went off. */
export function withoutLook(packet: ArrayBuffer): ArrayBuffer {
  const shorter = packet.slice(0, MOTION_BYTES);
  new DataView(shorter).setUint16(2, 0, true);
  return shorter;
}

const quaternion = new Float64Array(4);

/** Three components of 15 bits, of a quaternion without its largest one, then which that is. */
export function writeRotation(data: DataView, at: number, rotations: Numbers, joint: number): void {
  writeQuaternion(rotations, 9 * joint, quaternion);
  let largest = 0;
  for (let c = 1; c < 4; c++) if (Math.abs(quaternion[c]!) > Math.abs(quaternion[largest]!)) largest = c;
  const sign = quaternion[largest]! < 0 ? -1 : 1;
  const levels = [0, 1, 2, 3].filter((c) => c !== largest).map((c) => level(sign * quaternion[c]!));
  const [first, second, third] = levels as [number, number, number];
  data.setUint16(at, first | ((second & 1) << 15), true);
  data.setUint16(at + 2, (second >> 1) | ((third & 3) << 14), true);
  data.setUint16(at + 4, (third >> 2) | (largest << 13), true);
}

function level(component: number): number {
  return Math.min(Math.max(Math.round((component / REACH + 1) * 0.5 * ROTATION_STEPS), 0), ROTATION_STEPS);
}
