/** The size of the pictures that are asked for: the viewport's shape, as large as the connection carries. */

import { fitSize, highestStep, type Size } from "../viewpoint/framing";

const RESIZE_MS = 250;

export class PictureSize {
  /** What is asked for, px. */
  requested: Size = { width: 512, height: 512 };
  /** The viewport, CSS px. */
  private box: Size = { width: 16, height: 16 };
  private readonly resizes = new ResizeObserver(() => this.resized());
  private resizing: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly viewport: HTMLElement,
    /** A fixed square size, px, in place of the viewport's. */
    readonly pinned: number | null,
    /** The viewport has another size than before. */
    private readonly onResize: () => void,
  ) {}

  /** Width over height of what is seen: the viewport, and of a fixed square no more than its width. */
  get aspect(): number {
    const aspect = this.box.width / this.box.height;
    return this.pinned ? Math.min(1, aspect) : aspect;
  }

  /** The largest step that the viewport's pixels are worth. */
  get highest(): number {
    return highestStep(this.box.width * devicePixelRatio, this.box.height * devicePixelRatio);
  }

  follow(): void {
    this.resizes.observe(this.viewport);
  }

  /** Look at the viewport; false while it is not shown. */
  measure(): boolean {
    const { clientWidth: width, clientHeight: height } = this.viewport;
    if (width === 0 || height === 0) return false;
    this.box = { width, height };
    return true;
  }

  /** Ask for pictures of about `side` x `side` pixels. */
  fit(side: number): void {
    const { pinned, box } = this;
    this.requested = pinned ? { width: pinned, height: pinned } : fitSize(box.width, box.height, side);
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
