/** The size of the pictures that are asked for: the stage's shape, as large as the line carries. */

import { fittingSize, highestStep, type Size } from "../viewpoint/framing";

const RESIZE_MS = 250;

export class PictureSize {
  /** What is asked for, px. */
  now: Size = { width: 512, height: 512 };
  /** The stage, CSS px. */
  private box: Size = { width: 16, height: 16 };
  private readonly resizes = new ResizeObserver(() => this.resized());
  private resizing: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly stage: HTMLElement,
    /** A fixed square size, px, in place of the stage's. */
    readonly pinned: number | null,
    /** The stage has another size than before. */
    private readonly onResize: () => void,
  ) {}

  /** Width over height of the stage. */
  get aspect(): number {
    return this.box.width / this.box.height;
  }

  /** The largest step that the stage's pixels are worth. */
  get highest(): number {
    return highestStep(this.box.width * devicePixelRatio, this.box.height * devicePixelRatio);
  }

  follow(): void {
    this.resizes.observe(this.stage);
  }

  /** Look at the stage; false while it is not shown. */
  measure(): boolean {
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (width === 0 || height === 0) return false;
    this.box = { width, height };
    return true;
  }

  /** Ask for pictures of about `side` x `side` pixels. */
  fit(side: number): void {
    const { pinned, box } = this;
    this.now = pinned ? { width: pinned, height: pinned } : fittingSize(box.width, box.height, side);
  }

  close(): void {
    this.resizes.disconnect();
    clearTimeout(this.resizing);
  }

  private resized(): void {
    clearTimeout(this.resizing);
    this.resizing = setTimeout(this.onResize, RESIZE_MS);
  }
}
