/** A canvas that shows what leaves the device, and its track, which sends just that. */

import { LOOK_HEIGHT, LOOK_WIDTH } from "./cutOut";

export class LookTrack {
  readonly canvas = document.createElement("canvas");
  readonly track: MediaStreamTrack | null;
  private readonly pen: CanvasRenderingContext2D | null;

  constructor() {
    this.canvas.width = LOOK_WIDTH;
    this.canvas.height = LOOK_HEIGHT;
    // each picture is read back to be sent: it stays in memory, not on a graphics card
    this.pen = this.canvas.getContext("2d", { alpha: false, willReadFrequently: true });
    // a picture goes out when the canvas changes, and at no other time
    this.track = this.canvas.captureStream().getVideoTracks()[0] ?? null;
  }

  /** Show a picture and send it; it is used up. */
  show(picture: ImageBitmap): void {
    this.pen?.drawImage(picture, 0, 0);
    picture.close();
  }

  close(): void {
    this.track?.stop();
  }
}
