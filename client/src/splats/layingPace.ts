/**
 * Whether a device draws so quickly that pictures may be laid on people. That looks into the picture once a pixel of
 * each splat: next to nothing for a graphics card, half the time of drawing and more where a processor stands in.
 */

/** Share of a picture's time in which one without any is drawn where they may be laid. */
const QUICK = 0.4;
/** Share of it from which one with them came too slowly: more than laying them adds to one that was quick. */
const SLOW = 0.75;
/** Pictures that are judged together, and how many may be late for them to be laid, and to stay. */
const WINDOW = 30;
const LATE_BEFORE = 3;
const LATE_LAID = 15;

export class LayingPace {
  /** They may be laid; not before it is known that it is quick enough. */
  lays = false;
  private pictures = 0;
  private late = 0;

  /** `paceMs`: the time that a picture has. */
  constructor(private readonly paceMs: number) {}

  /** Tell of a picture that took `tookMs`. */
  observe(tookMs: number): void {
    this.pictures += 1;
    if (tookMs > (this.lays ? SLOW : QUICK) * this.paceMs) this.late += 1;
    if (this.pictures < WINDOW) return;
    this.lays = this.late <= (this.lays ? LATE_LAID : LATE_BEFORE);
    this.pictures = this.late = 0;
  }
}
