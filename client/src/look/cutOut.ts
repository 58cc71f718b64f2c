/** Draws what leaves the device for live look, in a worker: the person cut out, and the code. */

import { LIFT } from "./keying";
import { keptPixels, matteOf, type Mask } from "./matte";
import { CELLS, CELL_PX, pictureCodeCells } from "./pictureCode";
import { LookWindow, type SeenPoints } from "./window";

export const PICTURE_PX = 384;
/** A network's mask is no finer. */
const MATTE_PX = PICTURE_PX / 2;
export const LOOK_WIDTH = PICTURE_PX;
export const LOOK_HEIGHT = PICTURE_PX + CELLS * CELL_PX;

/** Between pictures: ten a second are sent, of a camera's thirty every third. Each has half as many bits again as of fifteen. */
const LEAST_MS = 75;

export class CutOut {
  private readonly page = penOf(LOOK_WIDTH, LOOK_HEIGHT);
  private readonly matte = penOf(MATTE_PX, MATTE_PX);
  private readonly window = new LookWindow();
  private drawnMs = -Infinity;

  /**
   * The picture of `timeMs`, of which `mask` and `seen` tell where the person is; null where they hardly are, and
   * where the last one was drawn a moment ago.
   */
  draw(picture: ImageBitmap, mask: Mask, seen: SeenPoints, timeMs: number): ImageBitmap | null {
    if (timeMs - this.drawnMs < LEAST_MS) return null;
    const square = this.window.follow(seen, timeMs);
    if (!square) return null;
    this.drawnMs = timeMs;
    const { page, matte } = this;
    const { x, y, side } = square;
    const kept = keptPixels(matteOf(mask, square, MATTE_PX));
    page.globalCompositeOperation = "copy";
    page.drawImage(picture, x, y, side, side, 0, 0, PICTURE_PX, PICTURE_PX);
    page.globalCompositeOperation = "source-over";
    page.fillStyle = `rgb(255 255 255 / ${LIFT / 255})`;
    page.fillRect(0, 0, PICTURE_PX, PICTURE_PX);
    matte.putImageData(imageOf(kept), 0, 0);
    page.globalCompositeOperation = "destination-in";
    page.drawImage(matte.canvas, 0, 0, PICTURE_PX, PICTURE_PX);
    page.globalCompositeOperation = "destination-over";
    page.fillStyle = "black";
    page.fillRect(0, 0, LOOK_WIDTH, LOOK_HEIGHT);
    page.globalCompositeOperation = "source-over";
    page.fillStyle = "white";
    pictureCodeCells(timeMs, square).forEach((white, index) => {
      const [row, column] = [Math.floor(index / CELLS), index % CELLS];
      if (white) page.fillRect(column * CELL_PX, PICTURE_PX + row * CELL_PX, CELL_PX, CELL_PX);
    });
    return page.canvas.transferToImageBitmap();
  }
}

function imageOf(pixels: Uint8ClampedArray): ImageData {
  return new ImageData(pixels as Uint8ClampedArray<ArrayBuffer>, MATTE_PX, MATTE_PX);
}

function penOf(width: number, height: number): OffscreenCanvasRenderingContext2D {
  const pen = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  if (!pen) throw new Error("a worker must be able to draw; got no context");
  return pen;
}
