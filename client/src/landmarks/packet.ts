/**
 * The `keypoints` packet: what the webcam shows of a person, and no picture. Little endian, 383 bytes,
 * and 18 more where anything is known of face or hands.
 *
 * Header, 16 bytes: u8 version, u8 kind, u16 flags, u32 sequence, f64 capture time (ms).
 * Payload: u16 width, u16 height (px of the picture), then of 33 landmarks i16 xy (1/8192 of the
 * picture's sides), i16 xyz (1/8192 m) and u8 visibility (1/255). Expression: u8 of seventeen
 * numbers (1/255), u8 bits of what is known (see `expression.ts`).
 */

import { EXPRESSION_COUNT, type ObservedExpression } from "./expression";

export const KEYPOINTS_BYTES = 383;
export const EXPRESSION_BYTES = EXPRESSION_COUNT + 1;
export const LANDMARK_COUNT = 33;
const VERSION = 1;
const KIND_KEYPOINTS = 1;
const STEPS = 8192;

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

export function encodeKeypoints(
  sequence: number,
  captureTimeMs: number,
  seen: Landmarks,
  expression: ObservedExpression | null = null,
): ArrayBuffer {
  const bytes = new ArrayBuffer(KEYPOINTS_BYTES + (expression ? EXPRESSION_BYTES : 0));
  const data = new DataView(bytes);
  data.setUint8(0, VERSION);
  data.setUint8(1, KIND_KEYPOINTS);
  data.setUint32(4, sequence, true);
  data.setFloat64(8, captureTimeMs, true);
  data.setUint16(16, seen.width, true);
  data.setUint16(18, seen.height, true);
  let at = 20;
  for (const values of [seen.xy, seen.world]) {
    for (const value of values) {
      data.setInt16(at, Math.max(-32768, Math.min(32767, Math.round(value * STEPS))), true);
      at += 2;
    }
  }
  for (const value of [...seen.visibility, ...(expression?.values ?? [])]) {
    data.setUint8(at++, Math.round(255 * Math.max(0, Math.min(1, value))));
  }
  if (expression) data.setUint8(at, expression.known);
  return bytes;
}
