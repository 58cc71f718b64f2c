/**
 * Which pixels show each splat, and how much of it each of them shows: what a picture is the sum of.
 *
 * Splats are blended front to back once a picture; both steps of colours then only add up products.
 */

import type { ProjectedSplats } from "./projected";

const MAX_OPACITY = 0.99;
/** A pixel that lets less through is finished. */
const FINISHED = 1 / 512;
/** Less of a splat is not worth a place in the list. */
const LEAST = 1 / 2048;
const PLACES_AT_FIRST = 1 << 19;

export class Footprints {
  /** Of the nth splat in `order` from `starts[n]` to before `starts[n + 1]`: pixels, and how much they show. */
  starts: Uint32Array;
  pixels = new Uint32Array(PLACES_AT_FIRST);
  weights = new Float32Array(PLACES_AT_FIRST);
  /** Splats by rising depth, of which the first `count` are drawn. */
  order: Uint32Array;
  count = 0;
  /** What each pixel lets through in the end. */
  readonly through: Float32Array;

  /** For `splats` splats in a picture of `side` px. */
  constructor(
    splats: number,
    private readonly side: number,
  ) {
    this.starts = new Uint32Array(splats + 1);
    this.order = new Uint32Array(splats);
    this.through = new Float32Array(side * side);
  }

  /** Blend the splats, of which `count` are drawn in this order. */
  fill(splats: ProjectedSplats, order: Uint32Array, count: number): void {
    this.through.fill(1);
    this.order = order;
    this.count = count;
    let end = 0;
    for (let n = 0; n < count; n++) {
      this.starts[n] = end;
      end = this.blend(splats, order[n]!, end);
    }
    this.starts[count] = end;
  }

  /** Draw the splats in these colours, as premultiplied RGBA. */
  draw(colours: Float32Array, into: Float32Array): void {
    const { starts, order, pixels, through, weights } = this;
    for (let pixel = 0; pixel < through.length; pixel++) {
      into[4 * pixel] = into[4 * pixel + 1] = into[4 * pixel + 2] = 0;
      into[4 * pixel + 3] = 1 - through[pixel]!;
    }
    for (let n = 0; n < this.count; n++) {
      const i = 3 * order[n]!;
      const [red, green, blue] = [colours[i]!, colours[i + 1]!, colours[i + 2]!];
      const end = starts[n + 1]!;
      for (let at = starts[n]!; at < end; at++) {
        const pixel = 4 * pixels[at]!;
        const weight = weights[at]!;
        into[pixel]! += weight * red;
        into[pixel + 1]! += weight * green;
        into[pixel + 2]! += weight * blue;
      }
    }
  }

  /** Blend splat `i`, whose footprint begins at `end`; returns where it ends. */
  private blend(splats: ProjectedSplats, i: number, end: number): number {
    const { side, through } = this;
    const [x, y, opacity] = [splats.x[i]!, splats.y[i]!, splats.opacity[i]!];
    const [a, b, c] = [-0.5 * splats.conics[3 * i]!, splats.conics[3 * i + 1]!, -0.5 * splats.conics[3 * i + 2]!];
    const [halfX, halfY] = [splats.reach[2 * i]!, splats.reach[2 * i + 1]!];
    const [left, right] = [Math.max(0, Math.ceil(x - halfX - 0.5)), Math.min(side - 1, Math.floor(x + halfX - 0.5))];
    const [top, bottom] = [Math.max(0, Math.ceil(y - halfY - 0.5)), Math.min(side - 1, Math.floor(y + halfY - 0.5))];
    this.reserve(end + Math.max(0, right - left + 1) * Math.max(0, bottom - top + 1));
    const { pixels, weights } = this;
    for (let row = top; row <= bottom; row++) {
      const dy = row + 0.5 - y;
      const fall = c * dy * dy;
      const slope = -b * dy;
      for (let column = left; column <= right; column++) {
        const pixel = row * side + column;
        const open = through[pixel]!;
        if (open < FINISHED) continue;
        const dx = column + 0.5 - x;
        const alpha = Math.min(opacity * Math.exp(fall + dx * (slope + a * dx)), MAX_OPACITY);
        const weight = alpha * open;
        if (weight < LEAST) continue;
        through[pixel] = open - weight;
        pixels[end] = pixel;
        weights[end] = weight;
        end += 1;
      }
    }
    return end;
  }

  private reserve(places: number): void {
    if (places <= this.pixels.length) return;
    const [pixels, weights] = [new Uint32Array(2 * places), new Float32Array(2 * places)];
    pixels.set(this.pixels);
    weights.set(this.weights);
    this.pixels = pixels;
    this.weights = weights;
  }
}
