/**
 * Packets of the channel `look`, in which pictures of people with live look come. services/live/look/packets.py
 * tells the layout and writes them; tests hold both to the same bytes.
 */

import { decodePose, type PosePacket } from "../transport/packets";

const VERSION = 1;
const KIND_FRAME = 4;
const KIND_POSE = 5;
const KIND_END = 6;
const HEAD_BYTES = 12;
const LENS_BYTES = 16;
const KEY_FRAME = 1;

/** Whom a packet is about: place in the cast, the cast's size, and `performerCheck` of whom the server means. */
export interface Whose {
  index: number;
  count: number;
  check: number;
}

/** A VP8 frame as its sender encoded it. */
export interface LookFrame extends Whose {
  kind: "frame";
  number: number;
  key: boolean;
  data: Uint8Array;
}

/** Where somebody was in the picture of the frame of this number. */
export interface LookPose extends Whose {
  kind: "pose";
  number: number;
  /** fx, fy, cx, cy of the picture, px. */
  lens: readonly [number, number, number, number];
  /** In the webcam's world; its capture time is the picture's moment, by the clock of all poses. */
  pose: PosePacket;
}

/** They have live look no longer. */
export interface LookEnd extends Whose {
  kind: "end";
}

/** What is in `bytes`; null for what is no packet of this version. */
export function decodeLook(bytes: ArrayBuffer): LookFrame | LookPose | LookEnd | null {
  const data = new DataView(bytes);
  if (data.byteLength < HEAD_BYTES || data.getUint8(0) !== VERSION) return null;
  const whose: Whose = { index: data.getUint8(2), count: data.getUint8(3), check: data.getUint16(4, true) };
  const number = data.getUint32(8, true);
  switch (data.getUint8(1)) {
    case KIND_FRAME: {
      const key = (data.getUint16(6, true) & KEY_FRAME) !== 0;
      return { kind: "frame", ...whose, number, key, data: new Uint8Array(bytes, HEAD_BYTES) };
    }
    case KIND_POSE: {
      const pose = decodePose(bytes.slice(HEAD_BYTES + LENS_BYTES));
      if (pose === null) return null;
      const lens = [0, 4, 8, 12].map((at) => data.getFloat32(HEAD_BYTES + at, true));
      return { kind: "pose", ...whose, number, lens: lens as unknown as LookPose["lens"], pose };
    }
    case KIND_END:
      return { kind: "end", ...whose };
    default:
      return null;
  }
}
