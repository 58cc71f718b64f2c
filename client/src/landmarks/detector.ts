/** Hands the newest camera picture to the worker that finds landmarks; none ever waits in a queue. */

import type { Landmarks } from "./landmarks";

export interface Picture {
  bitmap: ImageBitmap;
  /** When the camera took it, ms; rises from picture to picture. */
  timeMs: number;
  /** Whether the person is to be cut out of it, for live look. */
  look: boolean;
}

export type DetectorMessage =
  | { kind: "ready" }
  | { kind: "found"; timeMs: number; seen: Landmarks | null; look: ImageBitmap | null }
  | { kind: "failed"; reason: string };

export interface DetectorHooks {
  /** Landmarks of the picture of `timeMs`, null where nobody is in it; and what live look is to send of it. */
  onFound(seen: Landmarks | null, timeMs: number, look: ImageBitmap | null): void;
  onFailed(reason: string): void;
}

/** As much of a worker as is needed. */
export interface DetectorWorker {
  onmessage: ((event: MessageEvent<DetectorMessage>) => void) | null;
  onerror: ((event: ErrorEvent) => void) | null;
  postMessage(picture: Picture, transfer: Transferable[]): void;
  terminate(): void;
}

export class LandmarkDetector {
  /** The worker has a picture, or is not ready for one. */
  private busy = true;
  /** A picture came meanwhile. */
  private pendingMs: number | null = null;
  /** Whether people are to be cut out of the next pictures. */
  look = false;

  constructor(
    private readonly grab: () => Promise<ImageBitmap>,
    private readonly hooks: DetectorHooks,
    private readonly worker: DetectorWorker = new Worker(new URL("./worker.ts", import.meta.url), {
      type: "module",
    }),
  ) {
    worker.onmessage = ({ data }) => this.onMessage(data);
    worker.onerror = (event) => hooks.onFailed(event.message);
  }

  /** The camera has a new picture, taken at `timeMs`. */
  offer(timeMs: number): void {
    if (this.busy) this.pendingMs = timeMs;
    else void this.detect(timeMs);
  }

  close(): void {
    this.worker.onmessage = this.worker.onerror = null;
    this.busy = true;
    this.worker.terminate();
  }

  private onMessage(answer: DetectorMessage): void {
    if (answer.kind === "failed") return this.hooks.onFailed(answer.reason);
    this.busy = false;
    if (answer.kind === "found") this.hooks.onFound(answer.seen, answer.timeMs, answer.look);
    const { pendingMs } = this;
    // what the camera shows now is the newest, whichever picture was announced
    if (pendingMs !== null) void this.detect(pendingMs);
  }

  private async detect(timeMs: number): Promise<void> {
    this.busy = true;
    this.pendingMs = null;
    try {
      const bitmap = await this.grab();
      this.worker.postMessage({ bitmap, timeMs, look: this.look }, [bitmap]);
    } catch {
      // the camera has no picture just now: the next one will do
      this.busy = false;
    }
  }
}
