/** Who draws the picture: this device from poses, or the server by video. */

/** What the viewer asks for. */
export type Choice = "automatic" | "local" | "server";
export type Way = "local" | "server";

/** Who draws: what the viewer chose, who does, and why this device can't, if so. */
export interface Drawing {
  choice: Choice;
  way: Way;
  obstacle: string | null;
}

/** Speed of a trial from which this device keeps up with 30 poses a second and does all else. */
const ENOUGH_FPS = 45;
const SLOW_FPS = 20;
const SLOW_S = 4;

/** Chooses by a trial of what the device can draw, and gives way where it turns out to be too slow. */
export class WayChooser {
  private asked: Choice = "automatic";
  private trialFps = 0;
  private slow = 0;
  private tooSlow = false;

  get choice(): Choice {
    return this.asked;
  }

  /** The way to go where this device has everything it needs to draw. */
  get way(): Way {
    if (this.asked !== "automatic") return this.asked;
    return this.trialFps >= ENOUGH_FPS && !this.tooSlow ? "local" : "server";
  }

  choose(choice: Choice): void {
    this.asked = choice;
    this.slow = 0;
    this.tooSlow = false;
  }

  /** A trial on this cast drew so many pictures a second. */
  tried(fps: number): void {
    this.trialFps = fps;
    this.slow = 0;
    this.tooSlow = false;
  }

  /** Tell the pictures that this device drew in the last second, and whether smaller ones are left. */
  observe(fps: number, smallest: boolean): void {
    this.slow = fps < SLOW_FPS && smallest ? this.slow + 1 : 0;
    if (this.slow >= SLOW_S) this.tooSlow = true;
  }
}
