/** Sends keypoints over the meeting's connection, and nothing else; opens anew after it was cut. */

import { Problem, problemOf } from "../api/problem";
import type { ObservedExpression } from "./expression";
import { KEYPOINTS_BYTES, encodeKeypoints, type Landmarks } from "./packet";

/** As much of a data channel as is needed. */
export interface Channel {
  readonly readyState: RTCDataChannelState;
  readonly bufferedAmount: number;
  onmessage: ((event: MessageEvent) => void) | null;
  send(data: ArrayBuffer): void;
  close(): void;
}

const MOST_WAITING = 2 * KEYPOINTS_BYTES;

export class KeypointsChannel {
  private channel: Channel | null = null;
  private refused = false;
  private sequence = 0;

  /** `open` gives a channel that drives our performer, or null while there is no connection. */
  constructor(
    private readonly open: () => Channel | null,
    private readonly onRefused: (problem: Problem) => void,
  ) {}

  /** Send what the camera saw at `timeMs`, if it can go out at once; says whether it did. */
  send(seen: Landmarks, timeMs: number, expression: ObservedExpression | null = null): boolean {
    if (this.refused) return false;
    const channel = this.opened();
    if (channel?.readyState !== "open" || channel.bufferedAmount > MOST_WAITING) return false;
    this.sequence = (this.sequence + 1) >>> 0;
    channel.send(encodeKeypoints(this.sequence, timeMs, seen, expression));
    return true;
  }

  close(): void {
    this.refused = true;
    this.channel?.close();
  }

  private opened(): Channel | null {
    const state = this.channel?.readyState;
    if (state === "connecting" || state === "open") return this.channel;
    this.channel = this.open();
    if (this.channel) this.channel.onmessage = ({ data }) => this.hear(data);
    return this.channel;
  }

  /** The server speaks on this channel only to refuse. */
  private hear(message: unknown): void {
    if (typeof message !== "string" || this.refused) return;
    this.refused = true;
    const { status } = JSON.parse(message) as { status: number };
    this.onRefused(problemOf(status, message, null));
  }
}
