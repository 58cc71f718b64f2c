/** What a picture shows that the model does not show as well: renderer/live_look/coring.py, of pictures of `SIDE` px. */

import { chosenAround } from "./around";
import type { CutOutPicture } from "./pictureReader";

/** Difference, in sRGB, up to which a pixel shows nothing new, and from which all of what it shows. */
const EXPLAINED = 0.06;
const NEW = 0.15;
/** Alpha of the model from which its colour counts. */
const DRAWN = 0.5;
/** Alpha of the model up to which it is an outline, and from which it is none. */
const OUTLINE = 0.8;
const COVERED = 0.95;
const DARKEST = 0.02;
const EXPOSURE_RANGE = [0.7, 1.4] as const;

/**
 * How bright a picture is beside `drawn`, the model at its place (premultiplied RGBA), where both show the person;
 * null where they show nobody.
 */
export function exposureBeside({ rgb, known }: CutOutPicture, drawn: Float32Array): number[] | null {
  const [ofPicture, ofModel] = [[0, 0, 0], [0, 0, 0]];
  let count = 0;
  known.forEach((one, pixel) => {
    const alpha = drawn[4 * pixel + 3]!;
    if (one === 0 || alpha <= DRAWN) return;
    count += 1;
    for (let c = 0; c < 3; c++) {
      ofPicture[c]! += rgb[3 * pixel + c]!;
      ofModel[c]! += drawn[4 * pixel + c]! / alpha;
    }
  });
  if (count === 0) return null;
  return ofPicture.map((sum, c) => {
    const ratio = sum / count / Math.max(ofModel[c]! / count, DARKEST);
    return Math.max(EXPOSURE_RANGE[0], Math.min(ratio, EXPOSURE_RANGE[1]));
  });
}

export class Coring {
  private readonly own: Float32Array;
  private readonly least: Float32Array;
  private readonly most: Float32Array;
  private readonly inside: Float32Array;
  private readonly fresh: Float32Array;
  private readonly spread: Float32Array;
  private readonly row: Float32Array;
  private readonly wanted: Float32Array;

  /** Of pictures of `side` px. */
  constructor(private readonly side: number) {
    const pixels = side * side;
    [this.own, this.wanted] = [new Float32Array(3 * pixels), new Float32Array(3 * pixels)];
    [this.least, this.most] = [new Float32Array(pixels), new Float32Array(pixels)];
    [this.inside, this.fresh, this.spread] = [new Float32Array(pixels), new Float32Array(pixels), new Float32Array(pixels)];
    this.row = new Float32Array(pixels);
  }

  /**
   * The picture with, where it shows nothing new, the colour of `drawn`, the model there, in the picture's `exposure`.
   * The next call overwrites what this one returns.
   */
  of(picture: CutOutPicture, drawn: Float32Array, exposure: readonly number[]): CutOutPicture {
    const { fresh, inside, own, row, side, spread, wanted } = this;
    const { rgb, known } = picture;
    for (let pixel = 0; pixel < known.length; pixel++) {
      const alpha = drawn[4 * pixel + 3]!;
      inside[pixel] = Math.max(0, Math.min((alpha - OUTLINE) / (COVERED - OUTLINE), 1));
      for (let c = 0; c < 3; c++) {
        own[3 * pixel + c] = Math.min((drawn[4 * pixel + c]! / Math.max(alpha, 1e-3)) * exposure[c]!, 1);
      }
    }
    chosenAround(inside, side, Math.min, inside, row);
    for (let pixel = 0; pixel < known.length; pixel++) inside[pixel]! *= known[pixel]!;
    fresh.fill(-Infinity);
    for (let c = 0; c < 3; c++) this.addBeyond(rgb, drawn, c);
    for (let pixel = 0; pixel < known.length; pixel++) {
      fresh[pixel] = Math.max(0, Math.min((fresh[pixel]! - EXPLAINED) / (NEW - EXPLAINED), 1)) * inside[pixel]!;
    }
    chosenAround(fresh, side, Math.max, spread, row);
    for (let pixel = 0; pixel < known.length; pixel++) {
      const share = spread[pixel]! * inside[pixel]!;
      for (let at = 3 * pixel; at < 3 * pixel + 3; at++) wanted[at] = own[at]! + share * (rgb[at]! - own[at]!);
    }
    return { side, rgb: wanted, known };
  }

  /** Into `fresh`, how far each pixel is beyond the range of the model's colours round it in channel `c`, if that is more. */
  private addBeyond(rgb: Float32Array, drawn: Float32Array, c: number): void {
    const { fresh, least, most, own, row, side } = this;
    for (let pixel = 0; pixel < fresh.length; pixel++) {
      const isDrawn = drawn[4 * pixel + 3]! > DRAWN;
      least[pixel] = isDrawn ? own[3 * pixel + c]! : 2;
      most[pixel] = isDrawn ? own[3 * pixel + c]! : -1;
    }
    chosenAround(least, side, Math.min, least, row);
    chosenAround(most, side, Math.max, most, row);
    for (let pixel = 0; pixel < fresh.length; pixel++) {
      const seen = rgb[3 * pixel + c]!;
      fresh[pixel] = Math.max(fresh[pixel]!, least[pixel]! - seen, seen - most[pixel]!);
    }
  }
}
