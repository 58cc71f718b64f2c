/** How many pixels to ask for: what the stage can show, and what the connection can carry. */

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
/** The step below the smallest picture: none, and sound alone. */
const SOUND = -1;

/** The size in the shape of a stage of `width` x `height` px with about `side`^2 pixels in it. */
export function fittingSize(width: number, height: number, side: number): Size {
  const area = Math.max(width * height, 1);
  const scale = Math.min(side / Math.sqrt(area), LONGEST / Math.max(width, height, 1));
  const round = (length: number): number =>
    Math.max(SMALLEST, Math.round((length * scale) / BLOCK) * BLOCK);
  return { width: round(width), height: round(height) };
}

/** The largest step worth sending to a stage of `width` x `height` device pixels. */
export function highestStep(width: number, height: number): number {
  const index = SIDES.findIndex((side) => side * side >= width * height);
  return index === -1 ? SIDES.length - 1 : index;
}

const SLOW_FPS = 20;
const FLUENT_FPS = 27;
/** With fewer one can't follow what happens. */
export const FEW_FPS = 5;
const SLOW_S = 3;
const FLUENT_S = 6;
/** An encoder that starts afresh takes a moment to get going. */
const SETTLING_S = 2;
const LONGEST_WAIT_S = 120;

/**
 * Falls to smaller pictures when they come slowly; where the connection loses most of them, at once
 * to the smallest, and from there to sound alone. Climbs when they come fluently; from sound
 * alone, after a wait. A climb that had to be taken back makes the next one wait twice as long, one
 * that held half as long.
 */
export class SizeLadder {
  private index = FIRST_STEP;
  private slow = 0;
  private starved = 0;
  /** Seconds of fluent pictures, or of sound alone. */
  private fluent = 0;
  private wait = FLUENT_S;
  private climbed = false;
  private ignored = 0;

  get side(): number {
    return SIDES[this.index] ?? SIDES[0];
  }

  /** No pictures are to come for now. */
  get silent(): boolean {
    return this.index === SOUND;
  }

  /** The next seconds say nothing: something has just begun. */
  settle(): void {
    this.slow = this.starved = this.fluent = 0;
    this.ignored = SETTLING_S;
  }

  /** Go on with sound alone. */
  silence(): void {
    this.fall(SOUND);
  }

  /**
   * Tell the pictures of the last second, and whether the connection loses what is sent; says whether
   * the step changed.
   */
  observe(fps: number, highest: number, losing = false): boolean {
    if (this.ignored > 0) {
      this.ignored -= 1;
      return false;
    }
    this.slow = fps < SLOW_FPS ? this.slow + 1 : 0;
    this.starved = fps < FEW_FPS ? this.starved + 1 : 0;
    this.fluent = fps >= FLUENT_FPS || this.silent ? this.fluent + 1 : 0;
    if (this.index > highest) return this.fall(highest);
    if (this.slow >= SLOW_S && this.index > 0) return this.fall(losing && this.starved >= SLOW_S ? 0 : this.index - 1);
    if (this.starved >= SLOW_S && this.index === 0 && losing) return this.fall(SOUND);
    return this.fluent >= this.wait && this.index < highest && this.climb();
  }

  private fall(index: number): boolean {
    if (this.climbed) this.wait = Math.min(this.wait * 2, LONGEST_WAIT_S);
    this.climbed = false;
    return this.move(index);
  }

  private climb(): boolean {
    if (this.climbed) this.wait = Math.max(this.wait / 2, FLUENT_S);
    this.climbed = true;
    return this.move(this.index + 1);
  }

  private move(index: number): boolean {
    this.index = index;
    this.settle();
    return true;
  }
}
