import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Clip } from "../../src/enrolment/enrol";
import { beginGuide, goTo, passedSteps, type GuideState } from "../../src/enrolment/guide";
import { GuidedRecording } from "../../src/enrolment/guidedRecording";
import { joined, resumed, type GuideStore, type StoredGuide } from "../../src/enrolment/recordedSteps";
import { STEPS, type StepName } from "../../src/enrolment/steps";
import { DONE, observation, somebody } from "./people";

class FakeRecorder {
  static made: FakeRecorder[] = [];
  static isTypeSupported = (type: string): boolean => type.startsWith("video/webm");
  state = "inactive";
  ondataavailable: (event: { data: Blob }) => void = () => undefined;
  onstop: () => void = () => undefined;
  onerror: () => void = () => undefined;
  constructor() {
    FakeRecorder.made.push(this);
  }
  start(): void {
    this.state = "recording";
  }
  stop(): void {
    this.state = "inactive";
    this.ondataavailable({ data: new Blob([`take ${FakeRecorder.made.indexOf(this)}`]) });
    this.onstop();
  }
}

const settled = (): Promise<void> => new Promise((resolve) => setTimeout(resolve));

function setUp(stored: StoredGuide = { state: beginGuide(), recordings: {} }, isKept = true) {
  const states: GuideState[] = [];
  const clips: (Clip | null)[] = [];
  const saved: StoredGuide[] = [];
  const failures: unknown[] = [];
  const store: GuideStore = { load: async () => null, forget: async () => undefined, save: async (guide) => (saved.push(guide), isKept) };
  const clock = { ms: 0 };
  const hooks = { onState: (state: GuideState) => void states.push(state), onDone: (clip: Clip | null) => void clips.push(clip), onFailed: (error: unknown) => void failures.push(error) };
  const recording = new GuidedRecording({} as MediaStream, store, hooks, stored, () => clock.ms);
  recording.start();
  /** See so for `ms`. */
  const watch = (seen: Parameters<typeof observation>[1], ms: number): void => {
    for (const endMs = clock.ms + ms; clock.ms < endMs; clock.ms += 100) recording.observe(observation(clock.ms, seen));
  };
  return { recording, states, clips, saved, failures, clock, watch };
}

beforeEach(() => {
  FakeRecorder.made = [];
  vi.stubGlobal("MediaRecorder", FakeRecorder);
});
afterEach(() => vi.unstubAllGlobals());

describe("recording step by step", () => {
  it("films from when something is to be seen until the step is passed, and keeps that", async () => {
    const { recording, watch, saved } = setUp();
    watch(somebody({ headSize: 0.05 }), 2000);
    expect(FakeRecorder.made).toHaveLength(0);
    watch(DONE.face, 1000);
    expect(FakeRecorder.made.map(({ state }) => state)).toEqual(["recording"]);
    watch(DONE.face, 2500);
    expect(FakeRecorder.made[0]?.state).toBe("inactive");
    await settled();
    expect(recording.state.current).toBe("turn_left");
    expect(await saved.at(-1)?.recordings.face?.blob.text()).toBe("take 0");
  });

  it("gives one clip of what was passed, in the order of the steps", async () => {
    const { recording, watch, clips } = setUp();
    recording.skip();
    watch(DONE.turn_left, 2000);
    await settled();
    for (let skipped = 0; skipped < 5; skipped++) recording.skip();
    await settled();
    watch(DONE.hands, 500);
    await settled();
    expect(clips).toHaveLength(1);
    expect(clips.at(-1)).toMatchObject({ fileName: "webcam.webm" });
    recording.goTo("face");
    watch(DONE.face, 4000);
    await settled();
    const clip = clips.at(-1);
    expect(clip?.fileName).toBe("webcam.zip");
    expect(await clip?.preview?.text()).toBe("take 1");
    const text = await clip?.blob.text();
    expect(text?.indexOf("1-face.webm")).toBeGreaterThanOrEqual(0);
    expect(text?.indexOf("1-face.webm")).toBeLessThan(text?.indexOf("2-turn_left.webm") ?? 0);
  });

  it("gives none where every step was skipped", async () => {
    const { recording, clips } = setUp();
    for (const _ of STEPS) recording.skip();
    await settled();
    expect(clips).toEqual([null]);
    expect(FakeRecorder.made).toEqual([]);
  });

  it("throws away what belongs to a step that is skipped, or done anew", async () => {
    const { recording, watch, saved } = setUp();
    watch(DONE.face, 1000);
    recording.goTo("face");
    expect(FakeRecorder.made[0]?.state).toBe("inactive");
    watch(DONE.face, 1000);
    recording.skip();
    await settled();
    expect(FakeRecorder.made).toHaveLength(2);
    expect(saved.at(-1)?.recordings).toEqual({});
  });

  it("begins a step anew that takes half a minute", () => {
    const { recording, watch } = setUp();
    watch(DONE.face, 300);
    watch(somebody({ headSize: 0.05 }), 31_000);
    expect(FakeRecorder.made[0]?.state).toBe("inactive");
    expect(recording.state.current).toBe("face");
    watch(DONE.face, 300);
    expect(FakeRecorder.made).toHaveLength(2);
  });

  it("records from the start and is told when a step is done, where nothing can be checked", async () => {
    const { recording, clips } = setUp();
    recording.goUnchecked();
    expect(FakeRecorder.made).toHaveLength(1);
    for (const _ of STEPS) recording.pass();
    await settled();
    expect(FakeRecorder.made).toHaveLength(STEPS.length);
    expect(clips.at(-1)?.fileName).toBe("webcam.zip");
  });

  it("is gone on with at the step that was on, with what was recorded before", async () => {
    const first = setUp();
    first.watch(DONE.face, 4000);
    await settled();
    first.watch(DONE.turn_left, 500);
    first.recording.close();
    expect(FakeRecorder.made.every(({ state }) => state === "inactive")).toBe(true);
    const second = setUp(resumed(first.saved.at(-1) as StoredGuide));
    expect(second.recording.state.current).toBe("turn_left");
    for (let skipped = 0; skipped < 6; skipped++) second.recording.skip();
    await settled();
    expect(await second.clips.at(-1)?.blob.text()).toBe("take 0");
  });

  it("says so where the browser keeps nothing", async () => {
    const { recording } = setUp(undefined, false);
    recording.skip();
    await settled();
    expect(recording.isStored).toBe(false);
  });

  it("tells of a browser that cannot record", async () => {
    vi.stubGlobal("MediaRecorder", Object.assign(function () { throw new DOMException("no", "NotSupportedError"); }, { isTypeSupported: () => false }));
    const { watch, failures } = setUp();
    watch(DONE.face, 200);
    expect(failures.length).toBeGreaterThan(0);
  });
});

describe("what was stored", () => {
  it("does a step again whose recording did not come through", async () => {
    const outcomes = Object.fromEntries(STEPS.map(({ name }) => [name, name === "hands" ? "skipped" : "passed"]));
    const clip = { blob: new Blob(["x"]), fileName: "webcam.webm" };
    const recordings = Object.fromEntries(STEPS.filter(({ name }) => name !== "arms").map(({ name }) => [name, clip])) as StoredGuide["recordings"];
    const stored = { state: { ...beginGuide(), outcomes, current: null } as GuideState, recordings };
    const { state } = resumed(stored);
    expect(state.current).toBe("arms" satisfies StepName);
    expect(passedSteps(state)).toHaveLength(5);
    expect(await joined({ state: goTo(state, "arms"), recordings: {} })).toBeNull();
  });
});
