/**
 * Reads motion packets, and refuses what is no motion of a person, as the server does with what it can read:
 * services/live/motion/motion_packet.py, whose limits these are.
 */

import { EXPRESSION_COUNT } from "../landmarks/expression";
import { rotationMatrix, smallestThree } from "../viewpoint/geometry";
import { JOINT_COUNT } from "./body";
import { EXPRESSION_AT, KIND_MOTION, LIVE_LOOK, MOTION_BYTES, ROTATION_BYTES, ROTATION_STEPS, ROTATIONS_AT, TURN_STEPS, TURNS_AT, VERSION } from "./motionPacket"; // prettier-ignore
import type { LocalPose } from "./poseFilter";
import { lengthOf, type Numbers } from "./rotations";

const LATEST_MS = 2 ** 53;
const FARTHEST_M = 3;
const LARGEST_TURN_RAD = 3.15;
const FASTEST_M_S = 20;
/** Of three components, squared, none of which is larger than the one left out. */
const LONGEST = 0.751;

/** What somebody's page solved of one picture, as far as it is shown. */
export interface ReadMotion {
  /** By the clock of their page. */
  timeMs: number;
  now: LocalPose;
  /** In the 0.15 s from then: turns, rad [24 3], and a shift, m. */
  ahead: Numbers;
  aheadRoot: Numbers;
  /** 0 to 1. */
  expression: Numbers;
  /** How old the picture was as this left. */
  ageMs: number;
}

/** The motion in `packet`; null for what is none, or brings live look. */
export function readMotion(packet: ArrayBuffer): ReadMotion | null {
  const data = new DataView(packet);
  if (packet.byteLength !== MOTION_BYTES || data.getUint8(0) !== VERSION || data.getUint8(1) !== KIND_MOTION) return null;
  const [told, timeMs] = [data.getUint16(2, true), data.getFloat64(8, true)];
  if (told & LIVE_LOOK || !(timeMs >= 0 && timeMs <= LATEST_MS)) return null;
  const places = Float64Array.from({ length: 6 }, (_, i) => data.getFloat32(16 + 4 * i, true));
  if (!places.every((place) => Math.abs(place) <= FARTHEST_M)) return null;
  const scale = data.getFloat32(40, true);
  if (!(scale >= 0 && scale <= LARGEST_TURN_RAD)) return null;
  const local = new Float64Array(9 * JOINT_COUNT);
  for (let k = 0; k < JOINT_COUNT; k++) {
    const rotation = readRotation(data, ROTATIONS_AT + ROTATION_BYTES * k);
    if (!rotation) return null;
    local.set(rotation, 9 * k);
  }
  return {
    timeMs,
    now: { local, root: places.slice(0, 3) },
    ahead: Float64Array.from(new Int8Array(packet, TURNS_AT, 3 * JOINT_COUNT), (turn) => (turn * scale) / TURN_STEPS),
    aheadRoot: places.slice(3),
    expression: Float64Array.from(new Uint8Array(packet, EXPRESSION_AT, EXPRESSION_COUNT), (level) => level / 255),
    ageMs: told,
  };
}

/** Whether somebody can have come from `last` to `motion`: it is later, and they were no faster than anybody is. */
export function isPlausible(motion: ReadMotion, last: ReadMotion | null): boolean {
  if (!last) return true;
  const stepS = (motion.timeMs - last.timeMs) / 1000;
  const gone = motion.now.root.map((place, c) => place - last.now.root[c]!);
  return stepS > 0 && lengthOf(gone) <= FASTEST_M_S * stepS;
}

function readRotation(data: DataView, at: number): number[] | null {
  const [low, high] = [data.getUint32(at, true), data.getUint16(at + 4, true)];
  const three = [low & 0x7fff, (low >>> 15) & 0x7fff, (low >>> 30) | ((high & 0x1fff) << 2)];
  const square = three.reduce((sum, level) => sum + 0.5 * ((2 * level) / ROTATION_STEPS - 1) ** 2, 0);
  return square > LONGEST ? null : rotationMatrix(smallestThree(three, (high >>> 13) & 3, ROTATION_STEPS));
}
