/**
 * The `keypoints` packet: what the webcam shows of a person, and no picture. Little endian, 193 bytes, 206
 * where anything is known of face or hands; services/live/keypoints_packet.py tells what each bit holds, and
 * tests hold both to the same bytes.
 */

import { EXPRESSION_COUNT, type ObservedExpression } from "./expression";

export const KEYPOINTS_BYTES = 193;
export const LONGEST_KEYPOINTS_BYTES = 206;
export const LANDMARK_COUNT = 33;
const VERSION = 2;
const KIND_KEYPOINTS = 1;
/** The highest bit of the header's u16; the others hold the picture's age. */
const LIVE_LOOK = 0x8000;
/** To a metre, or to a side of the picture. */
const STEPS = 8192;
const BODY_BITS = 9;
const DETAIL_BITS = 6;
const VISIBILITY_BITS = 3;
const EXPRESSION_BITS = 6;
const KNOWN_BITS = 3;
/** Nose, shoulders, elbows, wrists, hips, knees, ankles. */
const BODY = [0, 11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28] as const;
/** Landmarks that belong to one of the body's: of the face, a hand or a foot. */
const DETAILS: Record<number, readonly number[]> = {
  0: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10],
  15: [17, 19, 21],
  16: [18, 20, 22],
  27: [29, 31],
  28: [30, 32],
};

/** One person in one picture, as MediaPipe's Pose Landmarker finds them. */
export interface Landmarks {
  /** px, of the picture. */
  width: number;
  height: number;
  /** x, y of each landmark, as shares of the picture's width and height. */
  xy: Float32Array;
  /** x, y, z of each, m: origin between the hips, x right, y down, z away from the camera. */
  world: Float32Array;
  /** Of each, 0 (hidden or outside) to 1 (seen). */
  visibility: Float32Array;
}

/** `ageMs`: how long ago the picture was taken; `liveLook`: whether pictures travel with the landmarks. */
export function encodeKeypoints(
  sequence: number,
  captureTimeMs: number,
  ageMs: number,
  seen: Landmarks,
  expression: ObservedExpression | null = null,
  liveLook = false,
): ArrayBuffer {
  const bytes = new ArrayBuffer(expression ? LONGEST_KEYPOINTS_BYTES : KEYPOINTS_BYTES);
  const data = new DataView(bytes);
  data.setUint8(0, VERSION);
  data.setUint8(1, KIND_KEYPOINTS);
  data.setUint16(2, clamped(Math.round(ageMs), 0, LIVE_LOOK - 1) | (liveLook ? LIVE_LOOK : 0), true);
  data.setUint32(4, sequence, true);
  data.setFloat64(8, captureTimeMs, true);
  data.setUint16(16, seen.width, true);
  data.setUint16(18, seen.height, true);
  const middle = [0, 1].map((axis) => middleOf(BODY.map((i) => seen.xy[2 * i + axis] ?? 0)));
  middle.forEach((steps, axis) => data.setInt16(20 + 2 * axis, steps, true));
  const offsets = [
    BODY.flatMap((i) => middle.map((steps, axis) => (seen.xy[2 * i + axis] ?? 0) - steps / STEPS)),
    BODY.flatMap((i) => [...seen.world.subarray(3 * i, 3 * i + 3)]),
    detailsOf(seen.xy, 2),
    detailsOf(seen.world, 3),
  ];
  const bits = new BitWriter(new Uint8Array(bytes, 32));
  offsets.forEach((values, group) => {
    const largest = Math.ceil(STEPS * Math.max(...values.map(Math.abs)));
    const scale = Math.min(largest, 0xffff);
    data.setUint16(24 + 2 * group, scale, true);
    const limit = 2 ** ((group < 2 ? BODY_BITS : DETAIL_BITS) - 1) - 1;
    for (const value of values) {
      const share = scale ? clamped((value * STEPS) / scale, -1, 1) : 0;
      bits.write(Math.round(limit * share) + limit, group < 2 ? BODY_BITS : DETAIL_BITS);
    }
  });
  for (const share of seen.visibility) bits.writeShare(share, VISIBILITY_BITS);
  if (expression) {
    for (let i = 0; i < EXPRESSION_COUNT; i++) bits.writeShare(expression.values[i] ?? 0, EXPRESSION_BITS);
    bits.write(expression.known, KNOWN_BITS);
  }
  return bytes;
}

/** Numbers of a few bits, one after the other, the least significant bit first. */
class BitWriter {
  private at = 0;

  constructor(private readonly bytes: Uint8Array) {}

  write(value: number, bits: number): void {
    for (let bit = 0; bit < bits; bit++, this.at++) {
      this.bytes[this.at >> 3]! |= ((value >> bit) & 1) << (this.at & 7);
    }
  }

  /** A number from 0 to 1. */
  writeShare(share: number, bits: number): void {
    this.write(Math.round((2 ** bits - 1) * clamped(share, 0, 1)), bits);
  }
}

/** Half way between the extremes, in steps. */
function middleOf(values: readonly number[]): number {
  return clamped(Math.round((STEPS * (Math.min(...values) + Math.max(...values))) / 2), -32768, 32767);
}

/** Of each detail the offset from what it belongs to. */
function detailsOf(values: Float32Array, axes: number): number[] {
  return Object.entries(DETAILS).flatMap(([anchor, details]) =>
    details.flatMap((i) =>
      Array.from({ length: axes }, (_, axis) => (values[axes * i + axis] ?? 0) - (values[axes * Number(anchor) + axis] ?? 0)),
    ),
  );
}

function clamped(value: number, low: number, high: number): number {
  return Math.max(low, Math.min(high, value));
}
