/**
 * A person on black, as live look sends them: lifted off it, so that the picture is its own matte.
 * services/live/look/keying.py tells why, and does the same.
 */

/** The darkest that a person is, of 255. */
export const LIFT = 36;
/** Luma (BT.601) that counts as none of the person, and as nothing else: coding leaves some noise on black. */
const BLACK = 12;
const PERSON = 28;

/** Give RGBA `pixels` of a sent picture the person's own colours, in place; their matte, 0 to 255, into `matte`. */
export function lower(pixels: Uint8ClampedArray, matte: Float32Array): void {
  const gain = 255 / (255 - LIFT);
  for (let pixel = 0; pixel < matte.length; pixel++) {
    const at = 4 * pixel;
    const [red, green, blue] = [pixels[at]!, pixels[at + 1]!, pixels[at + 2]!];
    const luma = 0.299 * red + 0.587 * green + 0.114 * blue;
    matte[pixel] = 255 * Math.max(0, Math.min((luma - BLACK) / (PERSON - BLACK), 1));
    pixels[at] = gain * (red - LIFT);
    pixels[at + 1] = gain * (green - LIFT);
    pixels[at + 2] = gain * (blue - LIFT);
  }
}
