/** Reads a decoded frame of live look: the person on black above (`CutOut` draws them). */

import { PICTURE_PX } from "../look/cutOut";
import { lower } from "../look/keying";
import { chosenAround } from "./around";
import type { FinePicture } from "./detail";

/** Matte from which a pixel shows nothing but the person, with all round it. */
const INSIDE = 230;
/** Colours are found in pictures made so large, px: a seventh of the work that all pixels are. */
export const SIDE = 144;

/** A person's picture: RGB of each pixel and how well it is known, each 0 to 1; black where it is not. */
export interface CutOutPicture {
  side: number;
  rgb: Float32Array;
  known: Float32Array;
}

export class PictureReader {
  private readonly small = penOf(SIDE);
  private readonly large = penOf(PICTURE_PX);

  /** The frame's picture of `SIDE` px, and, where `lays`, in all its pixels. */
  read(frame: CanvasImageSource, lays: boolean): { picture: CutOutPicture; fine: FinePicture | null } {
    const { small, large } = this;
    const picture = cutOutPicture(pixelsOf(frame, small, SIDE), SIDE);
    return { picture, fine: lays ? finePicture(pixelsOf(frame, large, PICTURE_PX), PICTURE_PX) : null };
  }
}

/** Of RGBA `sent`, `side` px large, as it was sent. */
export function cutOutPicture(sent: Uint8ClampedArray, side: number): CutOutPicture {
  const { rgba, known } = finePicture(sent, side);
  const rgb = new Float32Array(3 * side * side);
  for (let pixel = 0; pixel < side * side; pixel++) {
    for (let c = 0; c < 3; c++) rgb[3 * pixel + c] = rgba[4 * pixel + c]! / 255;
  }
  return { side, rgb, known: Float32Array.from(known) };
}

/** Of the same, with its colours as bytes; `sent` is overwritten. */
export function finePicture(sent: Uint8ClampedArray, side: number): FinePicture {
  const matte = new Float32Array(side * side);
  lower(sent, matte);
  return { side, rgba: sent, known: eroded(matte, side) };
}

function pixelsOf(frame: CanvasImageSource, pen: OffscreenCanvasRenderingContext2D, side: number): Uint8ClampedArray {
  pen.drawImage(frame, 0, 0, PICTURE_PX, PICTURE_PX, 0, 0, side, side);
  return pen.getImageData(0, 0, side, side).data;
}

function penOf(side: number): OffscreenCanvasRenderingContext2D {
  const pen = new OffscreenCanvas(side, side).getContext("2d", { willReadFrequently: true, alpha: false });
  if (!pen) throw new Error("a worker must be able to draw; got no context");
  return pen;
}

/** 1 where a pixel and all round it are inside the matte; beyond the picture's edge everything is. */
function eroded(matte: Float32Array, side: number): Uint8Array {
  chosenAround(matte, side, Math.min, matte, new Float32Array(matte.length));
  const known = new Uint8Array(matte.length);
  for (let pixel = 0; pixel < known.length; pixel++) known[pixel] = matte[pixel]! > INSIDE ? 1 : 0;
  return known;
}
