/**
 * Packets of the live connection: `view` goes up, 52 bytes; `pose` comes down, 176 bytes, and 16 more where
 * face or hands move (8 in recordings of an earlier version, of one curl a hand). Little endian.
 *
 * Header, 16 bytes: u8 version, u8 kind, u16 flags, u32 sequence, f64 capture time (ms).
 * Flags of a view, bit 0: show only what was filmed of a person; bit 1: this page draws the room, so
 * poses are wanted in place of pictures; bit 2: pictures are wanted and have stopped, so one that needs none
 * before it is; bit 3: neither pictures nor poses are wanted, audio only; bit 4: poses are wanted beside pictures.
 * A view's payload: f32 position[3] (world, m), f32 quaternion wxyz of camera_to_world (OpenCV camera axes),
 * f32 vertical field of view (rad), u16 width, u16 height (px).
 * Flags of a pose: how old, ms, the picture of the landmarks that it follows was when they left their page; 0: it
 * follows none.
 * A pose's payload: u8 index of the performer, u8 how many there are, u16 check of the performer's id,
 * f32 pelvis[3] (room, m), then 24 turns of 6 bytes: three components of 15 bits, two bits that say
 * which one was left out. Expression: u8 of seventeen numbers (1/255), u8 bits of what is known.
 * Poses of one tick may come as a batch: u8 version, u8 kind, then pose packets, each after a u8 of its length.
 */

import { EARLIER_COUNTS, EXPRESSION_COUNT, ofAnyVersion } from "../landmarks/expression";
import { smallestThree, type Quaternion, type Vec3 } from "../viewpoint/geometry";

export const VIEW_BYTES = 52;
const VERSION = 1;
const KIND_POSE = 2;
const KIND_VIEW = 3;
const KIND_BATCH = 7;
/** Protocol of the channel `pose` where the server may send the poses of a tick in one message. */
export const BATCHES = "batches";
const BATCH_HEAD_BYTES = 2;
const HIDE_UNSEEN = 1;
const RENDERS_LOCALLY = 2;
const STALLED = 4;
const AUDIO_ONLY = 8;
const POSES_TOO = 16;
export const POSE_BYTES = 176;
const JOINTS = 24;
export const ROTATIONS_AT = 32;
const ROTATION_STEPS = 32767;
/** Of face and both hands. */
const ALL_KNOWN = 7;
/** Of a pose alone, with an expression, and with one of an earlier version. */
const POSE_LENGTHS = [POSE_BYTES, ...[EXPRESSION_COUNT, ...EARLIER_COUNTS].map((count) => POSE_BYTES + count + 1)];

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
  /** The page draws the room: poses are wanted, and no pictures. */
  rendersLocally: boolean;
  /** Pictures are wanted, and none has been shown for a while. */
  stalled: boolean;
  /** The connection is too slow for pictures, and for poses. */
  audioOnly: boolean;
  /** Poses are wanted, whoever draws the room. */
  posesToo: boolean;
}

/** How one performer stands in the room. */
export interface PosePacket {
  sequence: number;
  /** Of the pose, on the server's clock. */
  captureTimeMs: number;
  /** Place in the cast, and the cast's size. */
  index: number;
  count: number;
  /** `performerCheck` of whom the server means. */
  check: number;
  /** Room, m. */
  pelvis: Vec3;
  /** 24 quaternions wxyz: of the pelvis in the room, of every other joint relative to its parent. */
  rotations: Float32Array;
  /** Of face and hands, 0 to 1, in the order of `EXPRESSION_NAMES`; all nil where nothing was sent. */
  expression: Float32Array;
}

export function encodeView(packet: ViewPacket): ArrayBuffer {
  const bytes = new ArrayBuffer(VIEW_BYTES);
  const data = new DataView(bytes);
  data.setUint8(0, VERSION);
  data.setUint8(1, KIND_VIEW);
  const drawing = (packet.hideUnseen ? HIDE_UNSEEN : 0) | (packet.rendersLocally ? RENDERS_LOCALLY : 0);
  const coming = (packet.stalled ? STALLED : 0) | (packet.audioOnly ? AUDIO_ONLY : 0) | (packet.posesToo ? POSES_TOO : 0);
  data.setUint16(2, drawing | coming, true);
  data.setUint32(4, packet.sequence, true);
  data.setFloat64(8, packet.captureTimeMs, true);
  const floats = [...packet.position, ...packet.wxyz, packet.fovYRad];
  floats.forEach((value, index) => data.setFloat32(16 + 4 * index, value, true));
  data.setUint16(48, packet.width, true);
  data.setUint16(50, packet.height, true);
  return bytes;
}

/** The pose packets in a message of the channel `pose`: those of a batch, or the one it is. */
export function posesIn(message: ArrayBuffer): ArrayBuffer[] {
  const data = new Uint8Array(message);
  if (data[0] !== VERSION || data[1] !== KIND_BATCH) return [message];
  const packets: ArrayBuffer[] = [];
  for (let at = BATCH_HEAD_BYTES; at < data.length;) {
    const [begin, end] = [at + 1, at + 1 + (data[at] ?? 0)];
    // what is cut off short is no pose
    if (end <= data.length) packets.push(message.slice(begin, end));
    at = end;
  }
  return packets;
}

/** What of a pose is needed before it is shown. */
export interface PoseHead {
  index: number;
  check: number;
  /** Of the pose, on the server's clock. */
  captureTimeMs: number;
  /** How old its picture was when it left; null: it follows none. */
  ageMs: number | null;
}

/** Whose pose is in `bytes`, and of when; null for what is no pose packet. */
export function poseHead(bytes: ArrayBuffer): PoseHead | null {
  const data = new DataView(bytes);
  if (!isPose(data)) return null;
  const [index, check] = [data.getUint8(16), data.getUint16(18, true)];
  return { index, check, captureTimeMs: data.getFloat64(8, true), ageMs: data.getUint16(2, true) || null };
}

function isPose(data: DataView): boolean {
  return POSE_LENGTHS.includes(data.byteLength) && data.getUint8(0) === VERSION && data.getUint8(1) === KIND_POSE;
}

/** The pose in `bytes`, or null for what is no pose packet of this version. */
export function decodePose(bytes: ArrayBuffer): PosePacket | null {
  const data = new DataView(bytes);
  if (!isPose(data)) return null;
  const turns = new Float32Array(4 * JOINTS);
  for (let joint = 0; joint < JOINTS; joint++) {
    const low = data.getUint32(ROTATIONS_AT + 6 * joint, true);
    const high = data.getUint16(ROTATIONS_AT + 6 * joint + 4, true);
    const three = [low & 0x7fff, (low >>> 15) & 0x7fff, (low >>> 30) | ((high & 0x1fff) << 2)];
    turns.set(smallestThree(three, (high >>> 13) & 3, ROTATION_STEPS), 4 * joint);
  }
  return {
    sequence: data.getUint32(4, true),
    captureTimeMs: data.getFloat64(8, true),
    index: data.getUint8(16),
    count: data.getUint8(17),
    check: data.getUint16(18, true),
    pelvis: [data.getFloat32(20, true), data.getFloat32(24, true), data.getFloat32(28, true)],
    rotations: turns,
    expression: expressionOf(bytes),
  };
}

/** A pose whose rotations are still to be written, from `ROTATIONS_AT` on. `ageMs` nil: it follows no picture. */
export function encodePoseHead(pose: Omit<PosePacket, "pelvis" | "rotations" | "expression"> & { pelvis: ArrayLike<number>; expression: ArrayLike<number>; ageMs: number }): ArrayBuffer {
  const bytes = new ArrayBuffer(POSE_BYTES + EXPRESSION_COUNT + 1);
  const data = new DataView(bytes);
  data.setUint8(0, VERSION);
  data.setUint8(1, KIND_POSE);
  data.setUint16(2, pose.ageMs, true);
  data.setUint32(4, pose.sequence, true);
  data.setFloat64(8, pose.captureTimeMs, true);
  data.setUint8(16, pose.index);
  data.setUint8(17, pose.count);
  data.setUint16(18, pose.check, true);
  for (let c = 0; c < 3; c++) data.setFloat32(20 + 4 * c, pose.pelvis[c]!, true);
  for (let i = 0; i < pose.expression.length; i++) data.setUint8(POSE_BYTES + i, Math.round(255 * pose.expression[i]!));
  data.setUint8(bytes.byteLength - 1, ALL_KNOWN);
  return bytes;
}

function expressionOf(bytes: ArrayBuffer): Float32Array {
  const told = Math.max(0, bytes.byteLength - POSE_BYTES - 1);
  if (told === 0) return new Float32Array(EXPRESSION_COUNT);
  const levels = new Uint8Array(bytes, POSE_BYTES, told);
  return Float32Array.from(ofAnyVersion(levels, 0), (level) => level / 255);
}

/** The low 16 bits of the CRC-32 of a performer's id, by which poses say whom they mean. */
export function performerCheck(id: string): number {
  let crc = 0xffffffff;
  for (const byte of new TextEncoder().encode(id)) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return ~crc & 0xffff;
}

/** Whether `sequence` comes after `than`, across the wrap at 2^32 (RFC 1982). */
export function isNewer(sequence: number, than: number): boolean {
  const ahead = (sequence - than) >>> 0;
  return ahead > 0 && ahead < 2 ** 31;
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

/** No picture for so long, ms, where 30 a second are wanted: what would show them was lost. */
const STALL_MS = 250;

/**
 * Notices that pictures stop. Browsers ask for a key frame when they can't decode what came; where a key frame
 * itself is lost, or the request, they wait.
 */
export class StallDetector {
  private shownMs = Infinity;

  /** A picture was shown. */
  shown(nowMs: number): void {
    this.shownMs = nowMs;
  }

  /** No pictures are expected until the next one. */
  pause(): void {
    this.shownMs = Infinity;
  }

  stalled(nowMs: number): boolean {
    return nowMs - this.shownMs > STALL_MS;
  }
}
