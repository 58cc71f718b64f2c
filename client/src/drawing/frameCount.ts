/** How many pictures a view has shown. */

export class FrameCount {
  /** Drawn by this device since the view was opened. */
  drawnHere = 0;
  private thisSecond = 0;

  drawn(): void {
    this.drawnHere += 1;
    this.shown();
  }

  /** A picture that came from the server, or was drawn here. */
  shown(): void {
    this.thisSecond += 1;
  }

  /** Pictures since this was asked last. */
  take(): number {
    const count = this.thisSecond;
    this.thisSecond = 0;
    return count;
  }
}
