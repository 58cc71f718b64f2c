/**
 * The `view` packet of the live connection: little endian, 52 bytes.
 *
 * Header, 16 bytes: u8 version, u8 kind, u16 flags, u32 sequence, f64 capture time (ms).
 * Flags, bit 0: show only what was filmed of a person.
 * Payload: f32 position[3] (world, m), f32 quaternion wxyz of camera_to_world (OpenCV camera axes),
 * f32 vertical field of view (rad), u16 width, u16 height (px).
 */

import type { Quaternion, Vec3 } from "./geometry";

export const VIEW_BYTES = 52;
const VERSION = 1;
const KIND_VIEW = 3;
const HIDE_UNSEEN = 1;

export interface ViewPacket {
  /** Counts up; wraps at 2^32. The newest one wins. */
  sequence: number;
  captureTimeMs: number;
  position: Vec3;
  wxyz: Quaternion;
  fovYRad: number;
  width: number;
  height: number;
  /** What was never filmed of a person, and is a guess, fades away. */
  hideUnseen: boolean;
}

export function encodeView(packet: ViewPacket): ArrayBuffer {
  const bytes = new ArrayBuffer(VIEW_BYTES);
  const data = new DataView(bytes);
  data.setUint8(0, VERSION);
  data.setUint8(1, KIND_VIEW);
  data.setUint16(2, packet.hideUnseen ? HIDE_UNSEEN : 0, true);
  data.setUint32(4, packet.sequence, true);
  data.setFloat64(8, packet.captureTimeMs, true);
  const floats = [...packet.position, ...packet.wxyz, packet.fovYRad];
  floats.forEach((value, index) => data.setFloat32(16 + 4 * index, value, true));
  data.setUint16(48, packet.width, true);
  data.setUint16(50, packet.height, true);
  return bytes;
}

/**
 * Decides when a view packet is sent: at most 60 times a second while the view changes, and often
 * enough while it rests that the server knows somebody still looks.
 */
export class Pacer {
  private nextMs = -Infinity;
  private sentMs = -Infinity;
  private changed = false;

  constructor(
    private readonly intervalMs = 1000 / 60,
    private readonly keepAliveMs = 400,
  ) {}

  /** Whether to send at `nowMs`; a change that comes too early is kept for the next call. */
  due(nowMs: number, changed: boolean): boolean {
    this.changed ||= changed;
    const resting = nowMs - this.sentMs >= this.keepAliveMs;
    // screens tick unevenly around 16.7 ms: a strict comparison would skip every second tick
    const jitterMs = 1;
    if (!resting && !(this.changed && nowMs >= this.nextMs - jitterMs)) return false;
    this.nextMs = Math.max(this.nextMs, nowMs - jitterMs) + this.intervalMs;
    this.sentMs = nowMs;
    this.changed = false;
    return true;
  }
}
