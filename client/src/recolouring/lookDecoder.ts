/** Frames of one person with live look, decoded by the browser. */

import type { LookFrame } from "./packets";

/** Decoded frames that wait for their pose, the newest: half a second's. */
export const MOST_WAITING = 8;

export class LookDecoder {
  private decoder: VideoDecoder | null = null;
  private readonly waiting = new Map<number, VideoFrame>();

  /** `onDecoded`: another frame can be taken. */
  constructor(private readonly onDecoded: () => void) {}

  /** Take the next frame; the first is a key frame. */
  decode({ number, key, data }: LookFrame): void {
    if (key && this.decoder?.state !== "configured") this.begin();
    if (this.decoder?.state !== "configured") return; // goes on with the next key frame
    this.decoder.decode(new EncodedVideoChunk({ type: key ? "key" : "delta", timestamp: number, data }));
  }

  /** Whether the frame of this number is decoded and not dropped yet. */
  has(number: number): boolean {
    return this.waiting.has(number);
  }

  /** Take the frame of this number, to be closed by whoever takes it; earlier ones are dropped. */
  take(number: number): VideoFrame | null {
    const frame = this.waiting.get(number) ?? null;
    for (const [earlier, one] of this.waiting) {
      if (earlier > number) break;
      if (earlier < number) one.close();
      this.waiting.delete(earlier);
    }
    return frame;
  }

  close(): void {
    if (this.decoder && this.decoder.state !== "closed") this.decoder.close();
    this.decoder = null;
    this.waiting.forEach((frame) => frame.close());
    this.waiting.clear();
  }

  private begin(): void {
    this.close();
    this.decoder = new VideoDecoder({
      output: (frame) => {
        const [oldest] = this.waiting;
        if (oldest && this.waiting.size >= MOST_WAITING) {
          oldest[1].close();
          this.waiting.delete(oldest[0]);
        }
        this.waiting.set(frame.timestamp, frame);
        this.onDecoded();
      },
      // it is closed by then, and made anew for the next key frame
      error: () => undefined,
    });
    this.decoder.configure({ codec: "vp8", optimizeForLatency: true });
  }
}
