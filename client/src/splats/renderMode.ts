/** Renderer: this device from poses, or the server by video. */

/** What the viewer asks for. */
export type RenderSetting = "automatic" | "local" | "server";
export type RenderMode = "local" | "server";

/** Who draws: what the viewer chose, who does, and why this device can't, if so. */
export interface RenderStatus {
  setting: RenderSetting;
  mode: RenderMode;
  obstacle: string | null;
}

/** Speed of a trial from which this device keeps up with 30 poses a second and does all else. */
export const ENOUGH_FPS = 45;
const SLOW_FPS = 20;
const SLOW_S = 4;

/** Chooses by a trial of what the device can draw, and gives way where it turns out to be too slow. */
export class RenderModeSelector {
  private chosen: RenderSetting = "automatic";
  private trialFps = 0;
  private slow = 0;
  private tooSlow = false;

  get setting(): RenderSetting {
    return this.chosen;
  }

  /** The way to go where this device has everything it needs to draw. */
  get mode(): RenderMode {
    if (this.chosen !== "automatic") return this.chosen;
    return this.trialFps >= ENOUGH_FPS && !this.tooSlow ? "local" : "server";
  }

  choose(choice: RenderSetting): void {
    this.chosen = choice;
    this.slow = 0;
    this.tooSlow = false;
  }

  /** A trial on this cast drew so many pictures a second, with fewer splats where that takes it. */
  setTrialFps(fps: number): void {
    this.trialFps = fps;
    this.slow = 0;
    this.tooSlow = false;
  }

  /** Tell the pictures that this device drew in the last second, and whether none are cheaper: smaller, or with fewer splats. */
  observe(fps: number, cheapest: boolean): void {
    this.slow = fps < SLOW_FPS && cheapest ? this.slow + 1 : 0;
    if (this.slow >= SLOW_S) this.tooSlow = true;
  }
}
