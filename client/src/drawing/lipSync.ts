/**
 * Lip sync: poses wait until the voice that goes with them is heard. A browser plays voices out of a jitter
 * buffer, 50 to 150 ms after they came; poses come as quickly, and would be drawn at once.
 *
 * A voice and the landmarks that go with it leave their page with a known delay between them: each pose tells how
 * old its picture was then. So both need no common clock but the page's own. What else a voice takes (packets of
 * 20 ms, mixing) and what else lips take (landmarks and poses 30 times a second, smoothing) is alike, some 50 ms:
 * measured (`metanerf bench lipsync`).
 *
 * Whoever has live look on waits for their picture as well, so that lips and their colours are of one instant.
 */

import { poseHead } from "../transport/packets";

/** Share of its pace by which motion may be slowed, or hastened, while it comes into step: nobody sees it. */
const MOST_CHANGE = 0.1;
/** A voice that is later than this is not waited for: a face that reacts late is worse. */
const MOST_MS = 250;
const USUAL_SHARE = 0.05;

/** One performer's poses on their way to the picture. */
class Held {
  private readonly waiting: { packet: ArrayBuffer; dueMs: number }[] = [];
  private delayMs = 0;
  private ageMs: number | null = null;
  private lastMs = -Infinity;

  /**
   * Take a pose whose picture was `ageMs` old when it left; null: it follows nobody live. It is seen `drawingMs`
   * after it was shown. What is drawn of live look is `lookMs` late.
   */
  accept(packet: ArrayBuffer, ageMs: number | null, voiceMs: number | null, lookMs: number, drawingMs: number, nowMs: number): void {
    this.ageMs = this.ageMs === null || ageMs === null ? ageMs : this.ageMs + USUAL_SHARE * (ageMs - this.ageMs);
    const wanted = voiceMs === null || this.ageMs === null ? 0 : voiceMs - this.ageMs - drawingMs;
    const change = MOST_CHANGE * Math.max(0, nowMs - this.lastMs);
    const target = Math.max(clamped(wanted, 0, MOST_MS), lookMs);
    if (Number.isFinite(this.lastMs)) this.delayMs = clamped(target, this.delayMs - change, this.delayMs + change);
    this.lastMs = nowMs;
    this.waiting.push({ packet, dueMs: nowMs + this.delayMs });
  }

  /** The poses that are due, the oldest first. */
  due(nowMs: number): ArrayBuffer[] {
    const later = this.waiting.findIndex(({ dueMs }) => dueMs > nowMs);
    return this.waiting.splice(0, later < 0 ? this.waiting.length : later).map(({ packet }) => packet);
  }
}

export class LipSync {
  private readonly held = new Map<number, Held>();
  /** From a pose that is shown to a picture of it. */
  private drawingMs = 0;
  /** Since the last picture: how many poses were shown, and when in the mean. */
  private shown = 0;
  private shownMs = 0;
  /** The same of each picture that is not finished; null: it shows no other poses than the one before. */
  private readonly submittedMs: (number | null)[] = [];

  /**
   * `voiceMs`: how late the voice of the performer at a place of the roster is heard; null: it is not heard. `lookMs`:
   * how late the live look of the performer of this check is drawn; nil: they have none.
   */
  constructor(
    private readonly voiceMs: (index: number) => number | null,
    private readonly show: (packet: ArrayBuffer) => void,
    private readonly lookMs: (check: number) => number = () => 0,
  ) {}

  /** A pose came. It is shown at once, unless its performer is heard and the voice is later. */
  accept(packet: ArrayBuffer, nowMs: number): void {
    const head = poseHead(packet);
    if (!head) return;
    const held = this.held.get(head.index) ?? new Held();
    this.held.set(head.index, held);
    held.accept(packet, head.ageMs, this.voiceMs(head.index), this.lookMs(head.check), this.drawingMs, nowMs);
    this.advance(nowMs);
  }

  /** Show what is due. */
  advance(nowMs: number): void {
    for (const held of this.held.values()) {
      for (const packet of held.due(nowMs)) {
        this.shown += 1;
        this.shownMs += (nowMs - this.shownMs) / this.shown;
        this.show(packet);
      }
    }
  }

  /** The page draws all that was shown; pictures are finished in this order. */
  submitted(): void {
    this.submittedMs.push(this.shown > 0 ? this.shownMs : null);
    this.shown = 0;
  }

  /** The oldest picture that was submitted is finished, and seen. */
  finished(nowMs: number): void {
    const shownMs = this.submittedMs.shift() ?? null;
    if (shownMs === null) return; // it showed the poses of the one before
    this.drawingMs += USUAL_SHARE * (clamped(nowMs - shownMs, 0, MOST_MS) - this.drawingMs);
  }

  /** Another connection: what waits belongs to the last one. */
  forget(): void {
    this.held.clear();
  }
}

function clamped(value: number, low: number, high: number): number {
  return Math.max(low, Math.min(high, value));
}
