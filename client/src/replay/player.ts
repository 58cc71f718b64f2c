/** The time of a replay: plays, rests, jumps, at a speed. No DOM in here. */

export const SPEEDS = [0.5, 1, 1.5, 2] as const;

export class Player {
  onChange: () => void = () => undefined;
  playing = false;
  speed = 1;
  private fromMs = 0;
  private sinceMs = 0;

  constructor(
    readonly durationMs: number,
    private readonly now: () => number = () => performance.now(),
  ) {}

  /** The moment that is shown, ms from the start; rests at the end. */
  get ms(): number {
    const passed = this.playing ? (this.now() - this.sinceMs) * this.speed : 0;
    return Math.min(this.durationMs, this.fromMs + passed);
  }

  get over(): boolean {
    return this.ms >= this.durationMs;
  }

  /** Go on, from the start where it is over. */
  play(): void {
    this.set(this.over ? 0 : this.ms, true);
  }

  pause(): void {
    this.set(this.ms, false);
  }

  seek(ms: number): void {
    this.set(Math.max(0, Math.min(this.durationMs, ms)), this.playing);
  }

  setSpeed(speed: number): void {
    const at = this.ms;
    this.speed = speed;
    this.set(at, this.playing);
  }

  /** Rest where the end was reached; called with each picture. */
  tick(): void {
    if (this.playing && this.over) this.pause();
  }

  private set(ms: number, playing: boolean): void {
    this.fromMs = ms;
    this.sinceMs = this.now();
    this.playing = playing;
    this.onChange();
  }
}

/** 75,000 ms: 1:15. */
export function clockText(ms: number): string {
  const seconds = Math.floor(ms / 1000);
  return `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
}
