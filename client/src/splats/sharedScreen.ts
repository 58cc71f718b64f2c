/** A screen that somebody shares, handed on picture by picture. */

export class SharedScreen {
  private video: HTMLVideoElement | null = null;
  private callback = 0;

  /** `show` is told of each of its pictures; null: none is shared. */
  constructor(private readonly show: (video: HTMLVideoElement | null) => void) {}

  /** Another screen from now on; null: none. */
  set(video: HTMLVideoElement | null): void {
    this.stop();
    this.video = video;
    if (video) this.watch(video);
    else this.show(null);
  }

  stop(): void {
    this.video?.cancelVideoFrameCallback(this.callback);
    this.video = null;
  }

  private watch(video: HTMLVideoElement): void {
    this.callback = video.requestVideoFrameCallback(() => {
      if (this.video !== video) return;
      this.show(video);
      this.watch(video);
    });
  }
}
