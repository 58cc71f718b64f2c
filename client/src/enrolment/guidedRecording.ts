/**
 * Records each step of a guide while it is done, keeps what was passed, and gives one clip of all in the end.
 * Knows nothing of the page.
 */

import { startRecording, type Recording } from "../capture/record";
import type { Clip } from "./enrol";
import { back, goTo, observe, pass, restart, skip, type GuideState } from "./guide";
import { joined, resumed, type GuideStore, type StoredGuide } from "./recordedSteps";
import type { Observation, StepName } from "./steps";

export interface GuidedRecordingHooks {
  onState(state: GuideState): void;
  /** Every step has its outcome: the clip of those that were passed, null of none. */
  onDone(clip: Clip | null): void;
  /** The browser can't record. */
  onFailed(error: unknown): void;
}

/** A step that takes longer begins anew: a clip is a sample of its pictures, and what is idle would fill it. */
const LONGEST_STEP_MS = 30_000;

export class GuidedRecording {
  private recording: { of: Recording; startMs: number } | null = null;
  private kept: StoredGuide["recordings"];
  private isClosed = false;
  /** Steps whose recordings are being put away. */
  private leaving = 0;
  state: GuideState;
  /** Whether a reload would find what is recorded. */
  isStored = true;
  /** Without a detector each step is recorded from its beginning, and people say when it is done. */
  isUnchecked = false;

  constructor(
    private readonly stream: MediaStream,
    private readonly store: GuideStore,
    private readonly hooks: GuidedRecordingHooks,
    { state, recordings }: StoredGuide,
    private readonly now: () => number = () => performance.now(),
  ) {
    this.state = state;
    this.kept = recordings;
  }

  /** What a later visit goes on with. */
  get stored(): StoredGuide {
    return resumed({ state: this.state, recordings: this.kept });
  }

  /** Tell how it stands, from the first step or from where it was left. */
  start(): void {
    this.move(this.state);
    if (this.state.current === null) void this.finish();
  }

  observe(observation: Observation): void {
    if (this.state.current === null) return;
    const tooLong = this.recording !== null && this.now() - this.recording.startMs > LONGEST_STEP_MS;
    if (tooLong) this.discard();
    this.move(observe(tooLong ? restart(this.state) : this.state, observation));
  }

  /** The live check is not to be had. */
  goUnchecked(): void {
    this.isUnchecked = true;
    this.start();
  }

  pass(): void {
    this.move(pass(this.state));
  }

  skip(): void {
    this.move(skip(this.state));
  }

  back(): void {
    this.move(back(this.state));
  }

  goTo(name: StepName): void {
    this.move(goTo(this.state, name), true);
  }

  /** Stop recording; what was passed stays kept for the next visit. */
  close(): void {
    this.isClosed = true;
    this.discard();
  }

  private move(next: GuideState, isAnew = false): void {
    const before = this.state;
    this.state = next;
    if (next.current !== before.current || isAnew) void this.leave(before.current);
    if (next.current !== null && !this.recording && (next.isUnderWay || this.isUnchecked)) this.begin();
    this.hooks.onState(next);
  }

  private begin(): void {
    try {
      const of = startRecording(this.stream);
      of.ended.catch((error: unknown) => this.isClosed || this.hooks.onFailed(error));
      this.recording = { of, startMs: this.now() };
    } catch (error) {
      this.hooks.onFailed(error);
    }
  }

  private async leave(name: StepName | null): Promise<void> {
    this.leaving += 1;
    const recording = this.recording?.of;
    this.recording = null;
    const ended = recording?.stop().catch(() => null);
    if (name !== null && this.state.outcomes[name] === "passed") {
      const clip = await ended;
      if (clip) this.kept = { ...this.kept, [name]: clip };
    }
    this.isStored = await this.store.save({ state: this.state, recordings: this.kept });
    this.leaving -= 1;
    if (this.isClosed) return;
    this.hooks.onState(this.state);
    if (this.state.current === null && this.leaving === 0) await this.finish();
  }

  private async finish(): Promise<void> {
    const clip = await joined({ state: this.state, recordings: this.kept });
    if (!this.isClosed && this.state.current === null) this.hooks.onDone(clip);
  }

  private discard(): void {
    void this.recording?.of.stop().catch(() => undefined);
    this.recording = null;
  }
}
