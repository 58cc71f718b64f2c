/**
 * Has a worker of its own look at face and hands, beside the one that finds the body: one part at a
 * time, never in a queue, half of its time at most, and not at all where the body detector is slow.
 */

import type { Square } from "../look/pictureCode";
import { cropOf, type Part } from "./crops";
import { EXPRESSION_COUNT, FACE, FACE_NUMBERS, FINGER_COUNT, LEFT_HAND, RIGHT_HAND, type ObservedExpression } from "./expression";
import type { ObservedHead } from "./head";
import type { Landmarks } from "./landmarks";

export interface PartPicture {
  part: Part;
  /** Of the camera's picture, px. */
  square: Square;
  bitmap: ImageBitmap;
  timeMs: number;
}

export type ExpressionMessage =
  | { kind: "ready"; parts: Part[] }
  /** What the part does: seven numbers of a face, five of a hand; null where it was not found. */
  | { kind: "found"; part: Part; timeMs: number; numbers: number[] | null; head: ObservedHead | null };

/** As much of a worker as is needed. */
export interface ExpressionWorker {
  onmessage: ((event: MessageEvent<ExpressionMessage>) => void) | null;
  postMessage(picture: PartPicture, transfer: Transferable[]): void;
  terminate(): void;
}

/** What a part tells stands twice as long as until it was last looked at anew, within these. */
const LEAST_HELD_MS = 300;
const MOST_HELD_MS = 1500;
const HELD = 2;
/** Time between two looks, in times of a look. */
const REST = 1;
/** The first look at a part takes long. */
const MOST_REST_MS = 500;
/** Between pictures of the body detector, ms, on average; beyond, everything is left to it. */
const SLOWEST_MS = 200;
const USUAL_SHARE = 0.1;
/** The face in two of three looks: it does more than hands, in less time. */
const TURNS: readonly Part[] = ["face", "left_hand", "face", "face", "right_hand", "face"];
const GROUPS: Record<Part, number> = { face: FACE, left_hand: LEFT_HAND, right_hand: RIGHT_HAND };
const FIRST_NUMBER: Record<Part, number> = { face: 0, left_hand: FACE_NUMBERS, right_hand: FACE_NUMBERS + FINGER_COUNT };

export class ExpressionDetector {
  /** The newest that was seen. */
  head: ObservedHead | null = null;
  private parts: Part[] = [];
  private busy = false;
  private turn = 0;
  private startedMs = -Infinity;
  private nextMs = -Infinity;
  private lastMs = -Infinity;
  private betweenMs = 0;
  private readonly values = new Float32Array(EXPRESSION_COUNT);
  private readonly seenMs: Record<Part, number> = { face: -Infinity, left_hand: -Infinity, right_hand: -Infinity };
  private readonly heldMs: Record<Part, number> = { face: 0, left_hand: 0, right_hand: 0 };

  constructor(
    private readonly grab: (square: Square) => Promise<ImageBitmap>,
    private readonly now: () => number = () => performance.now(),
    private readonly worker: ExpressionWorker = new Worker(new URL("./expressionWorker.ts", import.meta.url), {
      type: "module",
    }),
  ) {
    worker.onmessage = ({ data }) => this.onMessage(data);
  }

  /** The body was found so in the picture of `timeMs`: look at a part of it, if there is time. */
  offer(seen: Landmarks, timeMs: number): void {
    if (Number.isFinite(this.lastMs)) this.betweenMs += USUAL_SHARE * (timeMs - this.lastMs - this.betweenMs);
    this.lastMs = timeMs;
    if (this.busy || this.now() < this.nextMs || this.betweenMs > SLOWEST_MS) return;
    for (let tried = 0; tried < TURNS.length; tried++) {
      const part = TURNS[this.turn++ % TURNS.length] ?? "face";
      const square = this.parts.includes(part) ? cropOf(part, seen) : null;
      if (square) return void this.detect(part, square, timeMs);
    }
  }

  /** What face and hands do, as far as it was seen shortly before `timeMs`; null: nothing was. */
  at(timeMs: number): ObservedExpression | null {
    let known = 0;
    for (const part of this.parts) if (timeMs - this.seenMs[part] <= this.heldMs[part]) known |= GROUPS[part];
    return known ? { values: this.values.slice(), known } : null;
  }

  close(): void {
    this.worker.onmessage = null;
    this.busy = true;
    this.worker.terminate();
  }

  private async detect(part: Part, square: Square, timeMs: number): Promise<void> {
    this.busy = true;
    this.startedMs = this.now();
    try {
      const bitmap = await this.grab(square);
      this.worker.postMessage({ part, square, bitmap, timeMs }, [bitmap]);
    } catch {
      // the camera has no picture just now: the next one will do
      this.busy = false;
    }
  }

  private onMessage(answer: ExpressionMessage): void {
    if (answer.kind === "ready") {
      this.parts = answer.parts;
      return;
    }
    const { part, numbers, timeMs, head } = answer;
    this.head = head ?? this.head;
    const nowMs = this.now();
    this.nextMs = nowMs + Math.min(REST * (nowMs - this.startedMs), MOST_REST_MS);
    this.busy = false;
    if (!numbers) return;
    this.values.set(numbers, FIRST_NUMBER[part]);
    const heldMs = HELD * (timeMs - this.seenMs[part]);
    this.heldMs[part] = Math.min(MOST_HELD_MS, Math.max(LEAST_HELD_MS, heldMs));
    this.seenMs[part] = timeMs;
  }
}
