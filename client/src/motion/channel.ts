/** Sends a performer's motion over the meeting's connection, and nothing else; opens anew after it was cut. */

import { Problem, problemOf } from "../api/problem";
import type { SolvedBody } from "./body";
import { readBody } from "./constants";
import { LONGEST_MOTION_BYTES, stampMotion, withoutLook } from "./motionPacket";

/** As much of a data channel as is needed. */
export interface Channel {
  binaryType: BinaryType;
  readonly readyState: RTCDataChannelState;
  readonly bufferedAmount: number;
  onmessage: ((event: MessageEvent) => void) | null;
  send(data: ArrayBuffer | string): void;
  close(): void;
}

export interface ChannelHooks {
  /** The server tells whose poses are to be solved; after each opening anew. */
  onBody(body: SolvedBody): void;
  onRefused(problem: Problem): void;
}

const MAX_BUFFERED_BYTES = 2 * LONGEST_MOTION_BYTES;
/** Any text asks the server for the body. */
const WHOSE = "body";
/** Question and answer may be lost. */
const ASK_AGAIN_MS = 250;

export class MotionChannel {
  private channel: Channel | null = null;
  private closed = false;
  private sequence = 0;
  private askedMs = -Infinity;
  private told = false;
  private newest: ArrayBuffer | null = null;

  /** `open` gives a channel that drives our performer, or null while there is no connection. */
  constructor(
    private readonly open: () => Channel | null,
    private readonly hooks: ChannelHooks,
  ) {}

  /** Whether motion can go out now; opens a channel, and asks for the body, where that is needed. */
  ready(nowMs: number = performance.now()): boolean {
    const channel = this.usableChannel();
    if (channel?.readyState !== "open") return false;
    if (!this.told && nowMs - this.askedMs >= ASK_AGAIN_MS) {
      this.askedMs = nowMs;
      channel.send(WHOSE);
    }
    return this.told;
  }

  /** Send the packet of what the camera saw at `timeMs`, unless it would have to wait. */
  send(packet: ArrayBuffer, timeMs: number): void {
    const { channel } = this;
    if (this.closed || !this.told || channel?.readyState !== "open" || channel.bufferedAmount > MAX_BUFFERED_BYTES) return;
    this.sequence = (this.sequence + 1) >>> 0;
    stampMotion(packet, this.sequence, performance.timeOrigin + performance.now() - timeMs);
    this.newest = packet;
    channel.send(packet);
  }

  /** Tell the server at once that live look is off, whether or not anybody is in view. */
  endLook(): void {
    if (this.newest) this.send(withoutLook(this.newest), performance.timeOrigin + performance.now());
  }

  close(): void {
    this.closed = true;
    this.channel?.close();
  }

  private usableChannel(): Channel | null {
    if (this.closed) return null;
    const state = this.channel?.readyState;
    if (state === "connecting" || state === "open") return this.channel;
    [this.channel, this.told, this.askedMs] = [this.open(), false, -Infinity];
    if (this.channel) {
      this.channel.binaryType = "arraybuffer";
      this.channel.onmessage = ({ data }) => this.onMessage(data);
    }
    return this.channel;
  }

  /** The server tells the body when it is asked, and speaks in text only to refuse. */
  private onMessage(message: unknown): void {
    if (this.closed) return;
    if (message instanceof ArrayBuffer) {
      const body = this.told ? null : readBody(message);
      if (!body) return;
      this.told = true;
      this.hooks.onBody(body);
      return;
    }
    if (typeof message !== "string") return;
    this.closed = true;
    const { status } = JSON.parse(message) as { status: number };
    this.hooks.onRefused(problemOf(status, message, null));
  }
}
