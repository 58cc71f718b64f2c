/** How bright and how sharp a small picture is; whether that will do is for others to say. */

/** Of the square that is looked at: small, so that noise is no detail. */
export const SAMPLE_PX = 64;

export interface PictureQuality {
  /** What the brightest tenth is above, 0 to 1: dark skin and dark clothes are no dark picture. */
  brightness: number;
  /** How much of all variation is from one pixel to the next; 0 of a blurred picture, light or dark. */
  sharpness: number;
}

const BRIGHT_SHARE = 0.9;
/** Grey levels squared: noise alone has so little. */
const LEAST_VARIANCE = 4;

/** Of `SAMPLE_PX` x `SAMPLE_PX` pixels, RGBA. */
export function pictureQuality(pixels: Uint8ClampedArray): PictureQuality {
  const grey = new Float32Array(SAMPLE_PX * SAMPLE_PX);
  for (let i = 0; i < grey.length; i++) {
    grey[i] = 0.299 * (pixels[4 * i] ?? 0) + 0.587 * (pixels[4 * i + 1] ?? 0) + 0.114 * (pixels[4 * i + 2] ?? 0);
  }
  const sorted = grey.slice().sort();
  const brightness = (sorted[Math.floor(BRIGHT_SHARE * (sorted.length - 1))] ?? 0) / 255;
  return { brightness, sharpness: variance(laplacian(grey)) / Math.max(variance(grey), LEAST_VARIANCE) };
}

function laplacian(grey: Float32Array): Float32Array {
  const inner = SAMPLE_PX - 2;
  const out = new Float32Array(inner * inner);
  for (let row = 0; row < inner; row++) {
    for (let column = 0; column < inner; column++) {
      const at = (row + 1) * SAMPLE_PX + column + 1;
      const around = [at - 1, at + 1, at - SAMPLE_PX, at + SAMPLE_PX].reduce((sum, i) => sum + (grey[i] ?? 0), 0);
      out[row * inner + column] = around - 4 * (grey[at] ?? 0);
    }
  }
  return out;
}

function variance(values: Float32Array): number {
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  return values.reduce((sum, value) => sum + (value - mean) ** 2, 0) / values.length;
}
