/** How many pixels to ask for: what the viewport can show, and what the connection can carry. */

export interface Size {
  width: number;
  height: number;
}

/**
 * Steps of quality: sides, px, of a square with as many pixels as the picture. Few of them, because
 * every change of size makes the encoder start afresh.
 */
export const SIDES = [256, 384, 512, 720, 1024] as const;
/** Video is coded in blocks of 16 x 16 px. */
const BLOCK = 16;
const SMALLEST = 128;
const LONGEST = 1024;
const FIRST_STEP = 2;
/** The step below the smallest picture: none, and audio only. */
const AUDIO_ONLY = -1;

/**
 * The size in the shape of a viewport of `width` x `height` px with about `side`^2 pixels in it; more where its
 * shorter side would be less than 128 px.
 */
export function fitSize(width: number, height: number, side: number): Size {
  const area = Math.max(width * height, 1);
  const smallest = SMALLEST / Math.max(Math.min(width, height), 1);
  const scale = Math.min(Math.max(side / Math.sqrt(area), smallest), LONGEST / Math.max(width, height, 1));
  const round = (length: number): number =>
    Math.max(SMALLEST, Math.round((length * scale) / BLOCK) * BLOCK);
  return { width: round(width), height: round(height) };
}

/** The largest step worth sending to a viewport of `width` x `height` device pixels. */
export function highestStep(width: number, height: number): number {
  const index = SIDES.findIndex((side) => side * side >= width * height);
  return index === -1 ? SIDES.length - 1 : index;
}

const SLOW_FPS = 20;
const SMOOTH_FPS = 27;
/** With fewer one can't follow what happens. */
export const MIN_USABLE_FPS = 5;
const SLOW_S = 3;
const SMOOTH_S = 6;
/** An encoder that starts afresh takes a moment to get going. */
const SETTLING_S = 2;
const MAX_WAIT_S = 120;

/**
 * Falls to smaller pictures when they come slowly; where the connection loses most of them, at once
 * to the smallest, and from there to audio only. Climbs when they come fluently; from sound
 * alone, after a wait. A climb that had to be taken back makes the next one wait twice as long, one
 * that held half as long.
 */
export class ResolutionLadder {
  private index = FIRST_STEP;
  private slowSeconds = 0;
  private unusableSeconds = 0;
  /** Seconds of fluent pictures, or of audio only. */
  private smoothSeconds = 0;
  private waitS = SMOOTH_S;
  private steppedUp = false;
  private ignoredSeconds = 0;

  get side(): number {
    return SIDES[this.index] ?? SIDES[0];
  }

  /** No pictures are to come for now. */
  get audioOnly(): boolean {
    return this.index === AUDIO_ONLY;
  }

  /** The next seconds say nothing: something has just begun. */
  settle(): void {
    this.slowSeconds = this.unusableSeconds = this.smoothSeconds = 0;
    this.ignoredSeconds = SETTLING_S;
  }

  /** Go on with audio only. */
  dropToAudioOnly(): void {
    this.stepDown(AUDIO_ONLY);
  }

  /**
   * Tell the pictures of the last second, whether the connection loses what is sent, and whether what
   * is drawn is too coarse for larger pictures to be of use; says whether the step changed.
   */
  observe(fps: number, highest: number, lossy = false, coarse = false): boolean {
    if (this.ignoredSeconds > 0) {
      this.ignoredSeconds -= 1;
      return false;
    }
    this.slowSeconds = fps < SLOW_FPS ? this.slowSeconds + 1 : 0;
    this.unusableSeconds = fps < MIN_USABLE_FPS ? this.unusableSeconds + 1 : 0;
    this.smoothSeconds = fps >= SMOOTH_FPS || this.audioOnly ? this.smoothSeconds + 1 : 0;
    if (this.index > highest) return this.stepDown(highest);
    if (this.slowSeconds >= SLOW_S && this.index > 0) return this.stepDown(lossy && this.unusableSeconds >= SLOW_S ? 0 : this.index - 1);
    if (this.unusableSeconds >= SLOW_S && this.index === 0 && lossy) return this.stepDown(AUDIO_ONLY);
    return this.smoothSeconds >= this.waitS && this.index < highest && !coarse && this.stepUp();
  }

  private stepDown(index: number): boolean {
    if (this.steppedUp) this.waitS = Math.min(this.waitS * 2, MAX_WAIT_S);
    this.steppedUp = false;
    return this.move(index);
  }

  private stepUp(): boolean {
    if (this.steppedUp) this.waitS = Math.max(this.waitS / 2, SMOOTH_S);
    this.steppedUp = true;
    return this.move(this.index + 1);
  }

  private move(index: number): boolean {
    this.index = index;
    this.settle();
    return true;
  }
}
