/** Filming oneself step by step: what to do, whether it is done, and what has been seen; any step can be skipped. */

import { CAMERA_GONE, closeCamera, openCamera } from "../capture/record";
import { Problem, asProblem } from "../api/problem";
import type { Clip } from "../enrolment/enrol";
import { beginGuide, goTo, passedSteps, progressOf, seenSoFar, type GuideState } from "../enrolment/guide";
import { GuidedRecording } from "../enrolment/guidedRecording";
import { joined, type GuideStore, type StoredGuide } from "../enrolment/recordedSteps";
import { STEPS, stepOf, type Observation, type StepName } from "../enrolment/steps";
import { watch } from "../enrolment/watch";
import { Chime } from "./chime";
import { h } from "./dom";
import { guideScreen } from "./guideScreen";
import { guideSteps } from "./guideSteps";
import { seenFigure } from "./seenFigure";
import { button, notice, type View } from "./shell";

const PREPARE = "Seven short recordings: face, both profiles, body, arms, once around, hands. Each is checked as you go, and any can be skipped.";
const NOT_CHECKED = "Do it for a few seconds, then press Done.";
const NOT_KEPT = "This browser keeps no recordings: a reload of the page starts over.";

/** `onClip` gets the clip once every step is recorded or skipped, and null while that is not so. */
export function guidedRecorder(onClip: (clip: Clip | null) => void, store: GuideStore): View {
  return new GuidedRecorder(onClip, store);
}

class GuidedRecorder implements View {
  readonly element = h("div", { className: "guide", testId: "guide" });
  private readonly screen = guideScreen();
  private readonly figure = seenFigure();
  private readonly chime = new Chime();
  private readonly steps = guideSteps((name) => this.onStep(name));
  private readonly bar = h("div", { className: "actions" });
  private readonly note = h("p", { className: "secondary small guide-note", attributes: { role: "status" } });
  private readonly done = button("Done", () => this.guided?.pass(), { look: "primary", icon: "check", testId: "guide-done" });
  private readonly skip = button("Skip this step", () => this.guided?.skip(), { testId: "guide-skip" });
  private readonly back = button("Back", () => this.guided?.back(), { testId: "guide-back" });
  private guided: GuidedRecording | null = null;
  private stored: StoredGuide | null = null;
  private stream: MediaStream | null = null;
  private endWatch: () => void = () => undefined;
  private shown: StepName | null = null;
  /** Why the live check did not start; empty: it did. */
  private unchecked = "";
  private isClosed = false;

  constructor(
    private readonly onClip: (clip: Clip | null) => void,
    private readonly store: GuideStore,
  ) {
    void this.goOn();
  }

  close(): void {
    this.isClosed = true;
    this.release();
  }

  private async goOn(): Promise<void> {
    this.stored = await this.store.load();
    if (this.isClosed) return;
    if (!this.stored) return this.open(() => this.ready());
    // after a reload nobody has asked for the camera yet
    this.layOut();
    if (this.stored.state.current !== null) return this.ready();
    const clip = await joined(this.stored);
    if (!this.isClosed && !this.guided) this.onDone(clip);
  }

  private layOut(): void {
    const main = h("div", { className: "guide-main" }, this.screen.element, this.bar, this.note);
    this.element.replaceChildren(main, h("div", { className: "guide-side" }, this.steps.element, this.figure.element));
    this.show(this.stored?.state ?? beginGuide());
  }

  private show(state: GuideState): void {
    this.element.dataset["step"] = this.guided || state.current === null ? (state.current ?? "done") : "ready";
    this.steps.show(state);
    this.figure.show(seenSoFar(state));
  }

  /** Before it begins, or goes on. */
  private ready(): void {
    const { stored } = this;
    const recorded = stored ? passedSteps(stored.state).length : 0;
    this.screen.say(stored ? `${recorded} of ${STEPS.length} steps are recorded` : "Sit or stand in front of the camera", PREPARE);
    this.screen.progress(0);
    this.bar.replaceChildren(
      button(stored ? "Continue" : "Start", () => this.begin(), { look: "primary", icon: "camera", testId: "guide-start" }),
      ...(stored ? [button("Start over", () => this.startOver(), { testId: "guide-restart" })] : []),
    );
  }

  private begin(): void {
    if (!this.stream) return void this.open(() => this.begin());
    const hooks = {
      onState: (state: GuideState) => this.onState(state),
      onDone: (clip: Clip | null) => this.onDone(clip),
      onFailed: (error: unknown) => this.refused(error),
    };
    this.shown = null;
    this.chime.open();
    this.element.scrollIntoView?.({ block: "start" });
    this.guided = new GuidedRecording(this.stream, this.store, hooks, this.stored ?? { state: beginGuide(), recordings: {} });
    if (this.unchecked) this.guided.goUnchecked();
    else this.guided.start();
  }

  /** Chosen from the list, before it began too. */
  private onStep(name: StepName): void {
    if (this.guided) return this.guided.goTo(name);
    const { state, recordings } = this.stored ?? { state: beginGuide(), recordings: {} };
    this.stored = { state: goTo(state, name), recordings };
    this.begin();
  }

  private startOver(): void {
    void this.store.forget();
    this.guided?.close();
    this.guided = this.stored = null;
    this.onClip(null);
    this.element.scrollIntoView?.({ block: "start" });
    this.show(beginGuide());
    if (this.stream) this.ready();
    else void this.open(() => this.ready());
  }

  private onState(state: GuideState): void {
    this.show(state);
    const { current } = state;
    if (this.guided?.isStored === false) this.note.textContent = NOT_KEPT;
    if (current !== this.shown) this.change(current, state);
    if (current === null) return;
    this.screen.say(stepOf(current).instruction, this.unchecked ? NOT_CHECKED : state.words, state.isGood);
    this.screen.progress(progressOf(state));
  }

  /** To another step, or to the end. */
  private change(current: StepName | null, { outcomes }: GuideState): void {
    if (this.shown !== null && outcomes[this.shown] === "passed") this.celebrate();
    this.shown = current;
    this.onClip(null);
    if (current === null) this.screen.say("Preparing your clip…", "");
    this.back.disabled = current === STEPS[0]?.name;
    this.bar.replaceChildren(...(this.unchecked ? [this.done] : []), this.skip, this.back);
  }

  private celebrate(): void {
    this.screen.flash();
    this.chime.ring();
  }

  private onDone(clip: Clip | null): void {
    this.screen.progress(1);
    if (clip) this.screen.say("Your clip is ready", "Create your model below, or choose a step to record it again.", true);
    else this.screen.say("Nothing is recorded", "Every step was skipped. Choose one to record it.");
    this.bar.replaceChildren(button("Start over", () => this.startOver(), { icon: "reset", testId: "guide-restart" }));
    this.onClip(clip);
  }

  private onObservation(observation: Observation): void {
    this.guided?.observe(observation);
    const isDone = this.guided?.state.current === null;
    this.screen.draw(isDone ? null : observation.seen, this.guided?.state.isGood ?? true);
  }

  private onUnchecked(reason: string): void {
    this.unchecked = reason;
    this.screen.draw(null, false);
    this.note.textContent = `The steps cannot be checked live: ${reason}`;
    if (this.guided) this.change(this.guided.state.current, this.guided.state);
    this.guided?.goUnchecked();
  }

  private refused(error: unknown): void {
    if (this.isClosed) return;
    this.release();
    this.element.replaceChildren(notice(asProblem(error), button("Try again", () => void this.open(() => this.ready()))));
  }

  private async open(then: () => void): Promise<void> {
    this.layOut();
    this.bar.replaceChildren();
    this.unchecked = "";
    this.screen.say("Starting the camera…", "");
    try {
      const opened = await openCamera();
      if (this.isClosed) return closeCamera(opened);
      this.stream = opened;
      opened.getVideoTracks()[0]?.addEventListener("ended", () => this.refused(CAMERA_GONE));
      await this.screen.play(opened);
      const hooks = { onObservation: (one: Observation) => this.onObservation(one), onFailed: (reason: string) => this.onUnchecked(reason) };
      this.endWatch = watch(this.screen.video, hooks);
      then();
    } catch (error) {
      this.refused(error instanceof Problem ? error : CAMERA_GONE);
    }
  }

  /** The camera goes off; what was recorded is gone on with where it comes back. */
  private release(): void {
    this.endWatch();
    this.chime.close();
    this.guided?.close();
    this.stored = this.guided?.stored ?? this.stored;
    this.guided = null;
    closeCamera(this.stream);
    this.stream = null;
  }
}
