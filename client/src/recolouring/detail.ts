/** What splats lack beside a webcam's picture, pixel by pixel: renderer/live_look/detail.py. */

/** Added to both sRGB of a factor: in what is nearly black, noise is no detail. */
const LEAST = 0.04;
/** The largest factor, and the least one's inverse. */
const MOST = 4;
/** Alpha of the splats up to which a pixel tells nothing of them, and from which all. */
const BARE = 0.5;
const COVERED = 0.9;
/** Of a pixel and its neighbours, 1 2 1 along rows and columns, that are all known. */
const ALL_KNOWN = 16;

/** A person's picture in all its pixels: RGBA, and 1 where it is known, else 0. */
export interface FinePicture {
  side: number;
  rgba: Uint8ClampedArray;
  known: Uint8Array;
}

export class Detail {
  private readonly known: Uint8Array;
  private readonly factors: Float32Array;

  /** Of pictures of `side` px. */
  constructor(private readonly side: number) {
    this.known = new Uint8Array(side * side);
    this.factors = new Float32Array(3 * side * side);
  }

  /**
   * Red, green and blue of each pixel's factor; 1 where nothing is known. `drawn` is what the splats come to at the
   * picture's place, premultiplied RGBA, bytes. The next call overwrites what this one returns.
   */
  of({ rgba, known }: FinePicture, drawn: Uint8Array): Float32Array {
    const { factors, side } = this;
    soften(known, side, this.known);
    factors.fill(1);
    for (let pixel = 0; pixel < side * side; pixel++) {
      const alpha = drawn[4 * pixel + 3]! / 255;
      if (this.known[pixel] === 0 || alpha <= BARE) continue;
      const sure = (this.known[pixel]! / ALL_KNOWN) * Math.min((alpha - BARE) / (COVERED - BARE), 1);
      for (let c = 0; c < 3; c++) {
        // both as bytes; what is drawn is premultiplied
        const ratio = ((rgba[4 * pixel + c]! + 255 * LEAST) * alpha) / (drawn[4 * pixel + c]! + 255 * LEAST * alpha);
        factors[3 * pixel + c] = 1 + sure * (Math.max(1 / MOST, Math.min(ratio, MOST)) - 1);
      }
    }
    return factors;
  }
}

/** Sum each pixel of `known` with its neighbours, 1 2 1 along rows and columns, into `to`. */
function soften(known: Uint8Array, side: number, to: Uint8Array): void {
  const row = new Uint8Array(side);
  for (let y = 0; y < side; y++) {
    const here = side * y;
    const above = side * Math.max(0, y - 1);
    const below = side * Math.min(side - 1, y + 1);
    for (let x = 0; x < side; x++) row[x] = known[above + x]! + 2 * known[here + x]! + known[below + x]!;
    for (let x = 0; x < side; x++) to[here + x] = row[x === 0 ? 0 : x - 1]! + 2 * row[x]! + row[x === side - 1 ? x : x + 1]!;
  }
}
