/** What splats lack beside a webcam's picture, pixel by pixel: renderer/live_look/detail.py. */

/** Added to both sRGB of a factor: in what is nearly black, noise is no detail. */
const LEAST = 0.04;
/** The largest factor, and the least one's inverse. */
const MOST = 4;
/** Alpha of the splats up to which a pixel tells nothing of them, and from which all. */
const BARE = 0.5;
const COVERED = 0.9;
const LEAST_ALPHA = 1e-3;
/** Of a pixel and its neighbours, 1 2 1 along rows and columns, that are all known. */
const ALL_KNOWN = 16;

/** A person's picture in all its pixels: RGBA, of which more rows may follow, and 1 where it is known, else 0. */
export interface FinePicture {
  side: number;
  rgba: Uint8ClampedArray;
  known: Uint8Array;
}

export class Detail {
  private readonly drawn: Float32Array;
  private readonly known: Uint8Array;
  private readonly factors: Float32Array;

  /** Of pictures of `side` px, twice as large as what is drawn. */
  constructor(private readonly side: number) {
    this.drawn = new Float32Array(4 * side * side);
    this.known = new Uint8Array(side * side);
    this.factors = new Float32Array(3 * side * side);
  }

  /**
   * Red, green and blue of each pixel's factor; 1 where nothing is known. `drawn` is what the splats come to at the
   * picture's place, premultiplied RGBA. The next call overwrites what this one returns.
   */
  of({ rgba, known }: FinePicture, drawn: Float32Array): Float32Array {
    const { factors, side } = this;
    doubled(drawn, side / 2, 4, this.drawn);
    soften(known, side, this.known);
    factors.fill(1);
    for (let pixel = 0; pixel < side * side; pixel++) {
      const alpha = this.drawn[4 * pixel + 3]!;
      if (this.known[pixel] === 0 || alpha <= BARE) continue;
      const sure = (this.known[pixel]! / ALL_KNOWN) * Math.min((alpha - BARE) / (COVERED - BARE), 1);
      const scale = 1 / Math.max(alpha, LEAST_ALPHA);
      for (let c = 0; c < 3; c++) {
        const ratio = (rgba[4 * pixel + c]! / 255 + LEAST) / (scale * this.drawn[4 * pixel + c]! + LEAST);
        factors[3 * pixel + c] = 1 + sure * (Math.max(1 / MOST, Math.min(ratio, MOST)) - 1);
      }
    }
    return factors;
  }
}

/** Enlarge `from`, of `side` px with so many channels, to twice the size, bilinearly, into `to`. */
export function doubled(from: Float32Array, side: number, channels: number, to: Float32Array): void {
  const width = channels * side;
  const row = new Float32Array(width);
  for (let y = 0; y < 2 * side; y++) {
    const near = width * (y >> 1);
    const far = width * Math.max(0, Math.min((y >> 1) + (y & 1 ? 1 : -1), side - 1));
    for (let at = 0; at < width; at++) row[at] = 0.75 * from[near + at]! + 0.25 * from[far + at]!;
    let into = 2 * width * y;
    for (let at = 0; at < width; at += channels) {
      const left = at === 0 ? 0 : at - channels;
      const right = at === width - channels ? at : at + channels;
      for (let c = 0; c < channels; c++, into++) {
        to[into] = 0.75 * row[at + c]! + 0.25 * row[left + c]!;
        to[into + channels] = 0.75 * row[at + c]! + 0.25 * row[right + c]!;
      }
      into += channels;
    }
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
