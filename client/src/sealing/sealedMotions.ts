/**
 * Everybody's motion in a sealed meeting, from what the server passes on to poses as it would send them. Nobody moves
 * by anything else: who is not moved by their page, or by one whose packets do not open, stands at rest.
 */

import type { Performer } from "../api/types";
import { FollowedMotion, type ShownPose } from "../motion/followedMotion";
import { ROTATION_BYTES, writeRotation } from "../motion/motionPacket";
import { isPlausible, readMotion, type ReadMotion } from "../motion/motionReader";
import { multiply, rotationBy, turned } from "../motion/rotations";
import { ROTATIONS_AT, encodePoseHead, performerCheck } from "../transport/packets";
import type { MeetingKey } from "./meetingKey";
import { MotionOpener, SEALED_BYTES } from "./sealedPacket";

const VERSION = 1;
const KIND_SEALED_BATCH = 11;
const BATCH_HEAD_BYTES = 2;
const WHOSE_BYTES = 4;
const RECORD_BYTES = WHOSE_BYTES + SEALED_BYTES;
const POSES_PER_SECOND = 30;
/** Between the clocks of two devices that are set as well as usual; older motion is somebody's of earlier, sent again. */
const CLOCKS_MS = 5 * 60_000;
/** So long after a packet that did not open, somebody's motion counts as unreadable. */
const UNREADABLE_MS = 3000;

type Standing = Pick<Performer, "id" | "name" | "position" | "yaw_rad" | "viewpoint">;

/** One performer. */
class Mover {
  motion: FollowedMotion;
  private last: ReadMotion | null = null;
  private refusedMs = -Infinity;

  constructor(
    readonly performer: Standing,
    private readonly opener: MotionOpener | null,
  ) {
    this.motion = this.atRest;
  }

  /** Move as `packet` says, if it opens and is a person's motion. */
  async take(packet: ArrayBuffer, nowMs: number, wallMs: number): Promise<void> {
    const opened = (await this.opener?.open(packet)) ?? { kind: "old" };
    if (opened.kind === "refused") this.refusedMs = nowMs;
    if (opened.kind !== "opened") return;
    const motion = readMotion(opened.motion);
    if (opened.first) [this.last, this.motion] = [null, this.atRest];
    if (!motion || Math.abs(wallMs - motion.timeMs) > CLOCKS_MS || !isPlausible(motion, this.last)) {
      this.refusedMs = nowMs;
      return;
    }
    this.refusedMs = -Infinity;
    this.last = motion;
    this.motion.follow(motion, nowMs / 1000);
  }

  /** Whether what came of late does not open, or is nobody's motion now. */
  unreadable(nowMs: number): boolean {
    return nowMs - this.refusedMs < UNREADABLE_MS;
  }

  private get atRest(): FollowedMotion {
    const { viewpoint, yaw_rad: yawRad } = this.performer;
    return new FollowedMotion(viewpoint.azimuth_rad - yawRad);
  }
}

export class SealedMotions {
  /** Told whose motion does not open, whenever that changes. */
  onUnreadable: (names: readonly string[]) => void = () => undefined;
  private readonly movers = new Map<string, Mover>();
  private told = "";
  private sequence = 0;
  private dueMs = -Infinity;

  /** `performers`: who is shown, in the server's order; `clock`: the time of day, ms. */
  constructor(
    private readonly key: MeetingKey | null,
    private readonly meetingId: string,
    private readonly performers: () => readonly Standing[],
    private readonly clock: () => number = () => performance.timeOrigin + performance.now(),
  ) {}

  /** What the server passed on; resolves once it is followed. */
  async accept(message: ArrayBuffer, nowMs: number): Promise<void> {
    const data = new DataView(message);
    if (message.byteLength < BATCH_HEAD_BYTES || data.getUint8(0) !== VERSION || data.getUint8(1) !== KIND_SEALED_BATCH) return;
    const taken: Promise<void>[] = [];
    for (let at = BATCH_HEAD_BYTES; at + RECORD_BYTES <= message.byteLength; at += RECORD_BYTES) {
      const performer = this.performers()[data.getUint8(at)];
      if (!performer || performerCheck(performer.id) !== data.getUint16(at + 2, true)) continue;
      taken.push(this.mover(performer).take(message.slice(at + WHOSE_BYTES, at + RECORD_BYTES), nowMs, this.clock()));
    }
    await Promise.all(taken);
  }

  /**
   * Poses of everybody, 30 times a second; none in between, or while it is not known of all of them where their pelvis
   * is at rest, m.
   */
  due(nowMs: number, pelvises: readonly ArrayLike<number>[]): ArrayBuffer[] {
    const performers = this.performers();
    if (nowMs < this.dueMs || pelvises.length !== performers.length) return [];
    this.dueMs = Math.max(this.dueMs + 1000 / POSES_PER_SECOND, nowMs);
    this.sequence = (this.sequence + 1) >>> 0;
    this.tellUnreadable(nowMs);
    return performers.map((performer, index) => {
      const { motion } = this.mover(performer);
      const head = { sequence: this.sequence, captureTimeMs: this.clock(), index, count: performers.length, ageMs: motion.ageMs };
      return posePacket(performer, pelvises[index]!, motion.poseAt(nowMs / 1000), head);
    });
  }

  private tellUnreadable(nowMs: number): void {
    const names = this.performers().filter((one) => this.movers.get(one.id)?.unreadable(nowMs)).map(({ name }) => name);
    if (names.join() === this.told) return;
    this.told = names.join();
    this.onUnreadable(names);
  }

  private mover(performer: Standing): Mover {
    const known = this.movers.get(performer.id);
    if (known) return known;
    const made = new Mover(performer, this.key && new MotionOpener(this.key, this.meetingId, performer.id));
    this.movers.set(performer.id, made);
    return made;
  }
}

interface Head {
  sequence: number;
  captureTimeMs: number;
  index: number;
  count: number;
  ageMs: number;
}

/** `pose` at the place of `performer`, as the server would tell it. */
function posePacket(performer: Standing, rest: ArrayLike<number>, { local, root, expression }: ShownPose, head: Head): ArrayBuffer {
  const turn = rotationBy(0, performer.yaw_rad, 0);
  const pelvis = turned(turn, 0, root.map((place, c) => place + rest[c]!)).map((place, c) => place + performer.position[c]!);
  const rotations = local.slice();
  multiply(turn, 0, local, 0, rotations, 0);
  const bytes = encodePoseHead({ ...head, check: performerCheck(performer.id), pelvis, expression });
  const data = new DataView(bytes);
  for (let k = 0; 9 * k < local.length; k++) writeRotation(data, ROTATIONS_AT + ROTATION_BYTES * k, rotations, k);
  return bytes;
}
