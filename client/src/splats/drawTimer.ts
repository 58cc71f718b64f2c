/** What pictures take: from the first command of each until the card has finished it. */

/** Finished pictures are noticed so much later at most; browsers wait no shorter. */
const POLL_MS = 4;

/**
 * Counts only the time in which the card works on a picture. The time between pictures would also
 * tell of poses that come late, of a hidden page, and of a viewer who stands still.
 */
export class DrawTimer {
  private readonly pending: { sync: WebGLSync; startMs: number }[] = [];
  private finishedMs = -Infinity;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    private readonly onFinished: (tookMs: number) => void,
  ) {}

  /** All commands of a picture have been given since `startMs`. */
  submitted(startMs: number): void {
    const { gl, pending } = this;
    const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!sync) return; // the context is lost
    gl.flush();
    pending.push({ sync, startMs });
    if (pending.length === 1) this.pollLater();
  }

  private pollLater(): void {
    setTimeout(() => this.poll(), POLL_MS);
  }

  private poll(): void {
    const { gl, pending } = this;
    if (gl.isContextLost()) return void pending.splice(0);
    const waiting = pending.findIndex(({ sync }) => gl.getSyncParameter(sync, gl.SYNC_STATUS) !== gl.SIGNALED);
    this.finish(pending.splice(0, waiting < 0 ? pending.length : waiting));
    if (pending.length > 0) this.pollLater();
  }

  /** Tell of pictures that were finished since the last time: of several, what they took on average. */
  private finish(pictures: { sync: WebGLSync; startMs: number }[]): void {
    const [first] = pictures;
    if (!first) return;
    const nowMs = performance.now();
    // what a picture waited for the one before is not its own time
    const tookMs = (nowMs - Math.max(first.startMs, this.finishedMs)) / pictures.length;
    this.finishedMs = nowMs;
    for (const { sync } of pictures) {
      this.gl.deleteSync(sync);
      this.onFinished(tookMs);
    }
  }
}
