/** Reads a decoded frame of live look: the person cut out above, their matte below (`CutOut` draws them). */

import { LOOK_HEIGHT, PICTURE_PX } from "../look/cutOut";
import type { FinePicture } from "./detail";
import type { CutOutPicture } from "./liveColours";

/** Matte from which a pixel shows nothing but the person, with all round it. */
const INSIDE = 230;
const MATTE_PX = LOOK_HEIGHT - PICTURE_PX;
/** Colours are found in pictures made so large, px: half of what is sent, for a quarter of the work. */
export const SIDE = PICTURE_PX / 2;

export class PictureReader {
  private readonly pen: OffscreenCanvasRenderingContext2D;
  /** Of the newest frame. */
  private readonly matte = new Float32Array(MATTE_PX * MATTE_PX);
  private readonly fineMatte = new Float32Array(4 * MATTE_PX * MATTE_PX);

  constructor() {
    const pen = new OffscreenCanvas(PICTURE_PX, LOOK_HEIGHT).getContext("2d", { willReadFrequently: true, alpha: false });
    if (!pen) throw new Error("a worker must be able to draw; got no context");
    this.pen = pen;
  }

  /** The frame's picture of `SIDE` px, and what makes it in all its pixels. */
  read(frame: CanvasImageSource): { picture: CutOutPicture; fine: () => FinePicture } {
    const { pen, matte } = this;
    pen.drawImage(frame, 0, 0, PICTURE_PX, LOOK_HEIGHT);
    const { data } = pen.getImageData(0, 0, PICTURE_PX, LOOK_HEIGHT);
    for (let at = 0; at < matte.length; at++) {
      const row = PICTURE_PX + Math.floor(at / MATTE_PX);
      matte[at] = data[4 * (PICTURE_PX * row + (at % MATTE_PX)) + 1]!;
    }
    const picture = { side: SIDE, rgb: halved(data, PICTURE_PX), known: Float32Array.from(eroded(matte, SIDE)) };
    return { picture, fine: () => this.fine(data) };
  }

  private fine(rgba: Uint8ClampedArray): FinePicture {
    doubled(this.matte, MATTE_PX, this.fineMatte);
    return { side: PICTURE_PX, rgba, known: eroded(this.fineMatte, PICTURE_PX) };
  }
}

/** RGB of RGBA `data`, the picture's rows and then as many of its matte. */
export function cutOutPicture(data: Uint8ClampedArray, side: number): CutOutPicture {
  const rgb = new Float32Array(3 * side * side);
  for (let pixel = 0; pixel < side * side; pixel++) {
    for (let c = 0; c < 3; c++) rgb[3 * pixel + c] = data[4 * pixel + c]! / 255;
  }
  return { side, rgb, known: Float32Array.from(finePicture(data, side).known) };
}

/** Of the same `data`, as it is. */
export function finePicture(data: Uint8ClampedArray, side: number): FinePicture {
  const pixels = side * side;
  const matte = Float32Array.from({ length: pixels }, (_, pixel) => data[4 * (pixels + pixel) + 1]!);
  return { side, rgba: data, known: eroded(matte, side) };
}

/** RGB, 0 to 1, of an RGBA picture of `side` px, made half as large. */
function halved(data: Uint8ClampedArray, side: number): Float32Array {
  const small = side / 2;
  const rgb = new Float32Array(3 * small * small);
  const below = 4 * side;
  for (let pixel = 0; pixel < small * small; pixel++) {
    const at = 8 * (side * Math.floor(pixel / small) + (pixel % small));
    for (let c = at; c < at + 3; c++) {
      rgb[3 * pixel + c - at] = (data[c]! + data[c + 4]! + data[c + below]! + data[c + below + 4]!) / 1020;
    }
  }
  return rgb;
}

/** Enlarge `from`, of `side` px, to twice the size, bilinearly, into `to`. */
export function doubled(from: Float32Array, side: number, to: Float32Array): void {
  const row = new Float32Array(side);
  for (let y = 0; y < 2 * side; y++) {
    const near = side * (y >> 1);
    const far = side * Math.max(0, Math.min((y >> 1) + (y & 1 ? 1 : -1), side - 1));
    for (let x = 0; x < side; x++) row[x] = 0.75 * from[near + x]! + 0.25 * from[far + x]!;
    for (let x = 0; x < side; x++) {
      const into = 2 * (side * y + x);
      to[into] = 0.75 * row[x]! + 0.25 * row[Math.max(0, x - 1)]!;
      to[into + 1] = 0.75 * row[x]! + 0.25 * row[Math.min(side - 1, x + 1)]!;
    }
  }
}

/** 1 where a pixel and all round it are inside the matte; beyond the picture's edge everything is. */
function eroded(matte: Float32Array, side: number): Uint8Array {
  const known = new Uint8Array(matte.length);
  const row = new Uint8Array(side);
  for (let y = 0; y < side; y++) {
    const here = side * y;
    const above = side * Math.max(0, y - 1);
    const below = side * Math.min(side - 1, y + 1);
    for (let x = 0; x < side; x++) {
      row[x] = matte[above + x]! > INSIDE && matte[here + x]! > INSIDE && matte[below + x]! > INSIDE ? 1 : 0;
    }
    for (let x = 0; x < side; x++) known[here + x] = row[x === 0 ? 0 : x - 1]! & row[x]! & row[x === side - 1 ? x : x + 1]!;
  }
  return known;
}
