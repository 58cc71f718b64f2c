/** The matte of a square of a picture, as it is sent: how far each pixel is the person. */

import type { Square } from "./pictureCode";

/** Of a network's mask: less is not the person, and nothing of it leaves the device. */
const LEAST = 0.1;

/** How far each of a picture's pixels is the person, 0 to 1, row by row. */
export interface Mask {
  width: number;
  height: number;
  values: Float32Array;
}

/** `side` x `side` numbers, 0 to 255, of `square` of the mask's picture; 0 outside of it. */
export function matteOf({ width, height, values }: Mask, square: Square, side: number): Uint8ClampedArray {
  const matte = new Uint8ClampedArray(side * side);
  const step = square.side / side;
  for (let row = 0; row < side; row++) {
    const y = Math.floor(square.y + (row + 0.5) * step);
    if (y < 0 || y >= height) continue;
    for (let column = 0; column < side; column++) {
      const x = Math.floor(square.x + (column + 0.5) * step);
      const value = x < 0 || x >= width ? 0 : (values[y * width + x] ?? 0);
      if (value >= LEAST) matte[row * side + column] = 255 * value;
    }
  }
  return matte;
}

/** RGBA, of which alpha is what a matte leaves of a picture: all from one half on, less below. */
export function keptPixels(matte: Uint8ClampedArray): Uint8ClampedArray {
  // a pixel at a time: of a little-endian number the highest byte is alpha
  const kept = Uint32Array.from(matte, (value) => Math.min(255, 2 * value) << 24);
  return new Uint8ClampedArray(kept.buffer);
}
