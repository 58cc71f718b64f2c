/** Reads a decoded frame of live look: the person cut out above, their matte below (`CutOut` draws them). */

import { LOOK_HEIGHT, PICTURE_PX } from "../look/cutOut";
import type { CutOutPicture } from "./liveColours";

/** Matte from which a pixel shows nothing but the person, with all round it. */
const INSIDE = 230;
const MATTE_PX = LOOK_HEIGHT - PICTURE_PX;

export class PictureReader {
  private readonly pen: OffscreenCanvasRenderingContext2D;

  /** Of pictures made `side` px large. */
  constructor(private readonly side: number) {
    const pen = new OffscreenCanvas(side, 2 * side).getContext("2d", { willReadFrequently: true, alpha: false });
    if (!pen) throw new Error("a worker must be able to draw; got no context");
    this.pen = pen;
  }

  read(frame: CanvasImageSource): CutOutPicture {
    const { pen, side } = this;
    pen.drawImage(frame, 0, 0, PICTURE_PX, PICTURE_PX, 0, 0, side, side);
    pen.drawImage(frame, 0, PICTURE_PX, MATTE_PX, MATTE_PX, 0, side, side, side);
    const { data } = pen.getImageData(0, 0, side, 2 * side);
    return cutOutPicture(data, side);
  }
}

/** RGB of RGBA `data`, the picture's rows and then as many of its matte. */
export function cutOutPicture(data: Uint8ClampedArray, side: number): CutOutPicture {
  const pixels = side * side;
  const rgb = new Float32Array(3 * pixels);
  const inside = new Uint8Array(pixels);
  for (let pixel = 0; pixel < pixels; pixel++) {
    for (let c = 0; c < 3; c++) rgb[3 * pixel + c] = data[4 * pixel + c]! / 255;
    inside[pixel] = data[4 * (pixels + pixel) + 1]! > INSIDE ? 1 : 0;
  }
  return { side, rgb, known: eroded(inside, side) };
}

/** 1 where a pixel and all round it are inside; beyond the picture's edge everything is. */
function eroded(inside: Uint8Array, side: number): Float32Array {
  const known = new Float32Array(inside.length).fill(1);
  inside.forEach((one, pixel) => {
    if (one) return;
    const row = Math.floor(pixel / side);
    const column = pixel % side;
    for (let y = Math.max(0, row - 1); y <= Math.min(side - 1, row + 1); y++) {
      for (let x = Math.max(0, column - 1); x <= Math.min(side - 1, column + 1); x++) known[y * side + x] = 0;
    }
  });
  return known;
}
