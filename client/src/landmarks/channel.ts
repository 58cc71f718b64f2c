/** Sends keypoints over the meeting's connection, and nothing else; opens anew after it was cut. */

import { Problem, problemOf } from "../api/problem";
import type { ObservedExpression } from "./expression";
import { LONGEST_KEYPOINTS_BYTES, encodeKeypoints, type Landmarks } from "./packet";

/** As much of a data channel as is needed. */
export interface Channel {
  readonly readyState: RTCDataChannelState;
  readonly bufferedAmount: number;
  onmessage: ((event: MessageEvent) => void) | null;
  send(data: ArrayBuffer): void;
  close(): void;
}

const MAX_BUFFERED_BYTES = 2 * LONGEST_KEYPOINTS_BYTES;

export class KeypointsChannel {
  private channel: Channel | null = null;
  private closed = false;
  private sequence = 0;

  /** `open` gives a channel that drives our performer, or null while there is no connection. */
  constructor(
    private readonly open: () => Channel | null,
    private readonly onRefused: (problem: Problem) => void,
  ) {}

  /**
   * Send what the camera saw at `timeMs`, if it can go out at once; says whether it did. `liveLook`: whether
   * pictures travel with it; the server shows none any more from the first packet that comes without.
   */
  send(seen: Landmarks, timeMs: number, expression: ObservedExpression | null = null, liveLook = false): boolean {
    if (this.closed) return false;
    const channel = this.usableChannel();
    if (channel?.readyState !== "open" || channel.bufferedAmount > MAX_BUFFERED_BYTES) return false;
    this.sequence = (this.sequence + 1) >>> 0;
    const ageMs = performance.timeOrigin + performance.now() - timeMs;
    channel.send(encodeKeypoints(this.sequence, timeMs, ageMs, seen, expression, liveLook));
    return true;
  }

  close(): void {
    this.closed = true;
    this.channel?.close();
  }

  private usableChannel(): Channel | null {
    const state = this.channel?.readyState;
    if (state === "connecting" || state === "open") return this.channel;
    this.channel = this.open();
    if (this.channel) this.channel.onmessage = ({ data }) => this.onMessage(data);
    return this.channel;
  }

  /** The server speaks on this channel only to refuse. */
  private onMessage(message: unknown): void {
    if (typeof message !== "string" || this.closed) return;
    this.closed = true;
    const { status } = JSON.parse(message) as { status: number };
    this.onRefused(problemOf(status, message, null));
  }
}
