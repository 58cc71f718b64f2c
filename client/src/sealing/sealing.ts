/** What a page knows of a sealed meeting: its key, or that it has none. */

import type { Channel } from "../motion/channel";
import type { Meeting } from "../api/types";
import type { MeetingKey } from "./meetingKey";
import { SealedChannel } from "./sealedChannel";
import { SealedMotions } from "./sealedMotions";
import { MotionSealer } from "./sealedPacket";

export class Sealing {
  /** How everybody moves. */
  readonly motions: SealedMotions;

  /** `key`: null where the link brought none, or this browser can't use it. */
  constructor(
    private readonly meeting: Pick<Meeting, "id" | "performers">,
    readonly key: MeetingKey | null,
  ) {
    this.motions = new SealedMotions(key, meeting.id, () => meeting.performers);
  }

  /** What people compare; null without a key. */
  async code(): Promise<string | null> {
    return this.key?.code(this.meeting.id) ?? null;
  }

  /** A channel on which the motion of a performer leaves sealed; null without a key: none leaves. */
  channel(channel: Channel | null, performerId: string): Channel | null {
    if (!channel || !this.key) return null;
    return new SealedChannel(channel, new MotionSealer(this.key, this.meeting.id, performerId));
  }
}

/** Whether this browser seals at all: only on pages that come encrypted, or from this device. */
export function canSeal(): boolean {
  return (crypto as Partial<Crypto>).subtle !== undefined;
}
