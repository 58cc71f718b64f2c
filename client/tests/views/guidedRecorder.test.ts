// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Clip } from "../../src/enrolment/enrol";
import { beginGuide, pass, skip } from "../../src/enrolment/guide";
import type { GuideStore, StoredGuide } from "../../src/enrolment/recordedSteps";
import type { WatchHooks } from "../../src/enrolment/watch";
import { guidedRecorder } from "../../src/views/guidedRecorder";
import { DONE, observation, somebody } from "../enrolment/people";

const watched: { hooks: WatchHooks | null; ended: number } = vi.hoisted(() => ({ hooks: null, ended: 0 }));
vi.mock("../../src/enrolment/watch", () => ({
  watch: (_: unknown, hooks: WatchHooks) => {
    watched.hooks = hooks;
    return () => (watched.ended += 1);
  },
}));

class FakeTrack extends EventTarget {
  stopped = false;
  stop(): void {
    this.stopped = true;
  }
}

class FakeRecorder {
  static isTypeSupported = (): boolean => true;
  state = "inactive";
  ondataavailable: (event: { data: Blob }) => void = () => undefined;
  onstop: () => void = () => undefined;
  start(): void {
    this.state = "recording";
  }
  stop(): void {
    this.state = "inactive";
    this.ondataavailable({ data: new Blob(["pictures"]) });
    this.onstop();
  }
}

const settled = (): Promise<void> => new Promise((resolve) => setTimeout(resolve, 5));
let close: () => void = () => undefined;

async function setUp({ stored = null as StoredGuide | null, open = undefined as (() => Promise<unknown>) | undefined, isKept = true } = {}) {
  const track = new FakeTrack();
  const stream = { getTracks: () => [track], getVideoTracks: () => [track] };
  const getUserMedia = vi.fn(open ?? (async () => stream));
  vi.stubGlobal("navigator", Object.assign(Object.create(navigator), { mediaDevices: { getUserMedia } }));
  const clips: (Clip | null)[] = [];
  const store = { load: async () => stored, save: vi.fn(async () => isKept), forget: vi.fn(async () => undefined) } satisfies GuideStore;
  const view = guidedRecorder((clip) => clips.push(clip), store);
  close = () => view.close();
  await settled();
  const find = (testId: string): HTMLElement => view.element.querySelector<HTMLElement>(`[data-testid="${testId}"]`) ?? expect.fail(`${testId} is not in “${view.element.textContent}”`);
  const press = async (testId: string): Promise<void> => (find(testId).click(), settled());
  const says = (testId: string): string | null => find(testId).textContent;
  let ms = 0;
  const watch = async (seen: Parameters<typeof observation>[1], forMs: number): Promise<void> => {
    for (const endMs = ms + forMs; ms < endMs; ms += 100) watched.hooks?.onObservation(observation(ms, seen));
    await settled();
  };
  return { view, clips, store, track, getUserMedia, find, press, says, watch };
}

beforeEach(() => {
  watched.hooks = null;
  watched.ended = 0;
  vi.stubGlobal("MediaRecorder", FakeRecorder);
  Object.defineProperty(HTMLMediaElement.prototype, "srcObject", { writable: true, value: null, configurable: true });
  HTMLMediaElement.prototype.play = async () => undefined;
  HTMLCanvasElement.prototype.getContext = (() => null) as typeof HTMLCanvasElement.prototype.getContext;
});
afterEach(() => {
  close();
  vi.unstubAllGlobals();
});

describe("being guided through an enrolment", () => {
  it("shows the camera first, and begins when one is ready", async () => {
    const { says, press, watch } = await setUp();
    await watch(DONE.face, 5000);
    expect(says("guide-instruction")).toBe("Sit or stand in front of the camera");
    await press("guide-start");
    expect(says("guide-instruction")).toBe("Come close and look at the camera");
  });

  it("says what is wrong, counts while it is right, and goes on", async () => {
    const { view, says, press, watch, find } = await setUp();
    await press("guide-start");
    await watch(somebody({ headSize: 0.05 }), 500);
    expect(says("guide-words")).toBe("Come closer to the camera.");
    expect(find("guide-words").classList.contains("good")).toBe(false);
    await watch(DONE.face, 2000);
    expect(says("guide-words")).toBe("Good. Hold still.");
    expect(Number(find("guide-progress").getAttribute("aria-valuenow"))).toBeGreaterThan(50);
    await watch(DONE.face, 1500);
    expect(says("guide-instruction")).toBe("Turn your head to the left");
    expect(find("step-face").textContent).toContain("Recorded");
    expect(find("step-turn_left").getAttribute("aria-current")).toBe("step");
    expect(find("guide-hint").textContent).toBe("Would help most: turn your head to the left.");
    expect(view.element.querySelector('[data-part="head-front"]')?.hasAttribute("data-seen")).toBe(true);
  });

  it("gives a clip once each step is done or skipped, and takes it back where one is done again", async () => {
    const { press, watch, clips, says, find } = await setUp();
    await press("guide-start");
    await watch(DONE.face, 4000);
    for (let left = 6; left > 0; left--) await press("guide-skip");
    expect(clips.at(-1)?.fileName).toMatch(/^webcam\./);
    expect(says("guide-instruction")).toBe("Your clip is ready");
    expect(find("step-hands").textContent).toContain("Skipped");
    await press("step-hands");
    expect(clips.at(-1)).toBeNull();
    expect(says("guide-instruction")).toBe("Hold both hands up, palms to the camera");
    await press("guide-back");
    expect(says("guide-instruction")).toMatch(/turn around once/);
  });

  it("begins with the step that is chosen from the list", async () => {
    const { press, says } = await setUp();
    await press("step-arms");
    expect(says("guide-instruction")).toMatch(/^Hold your arms out/);
    await press("guide-skip");
    expect(says("guide-instruction")).toMatch(/^Come close/);
  });

  it("gives none where everything was skipped", async () => {
    const { press, clips, says } = await setUp();
    await press("guide-start");
    for (let left = 7; left > 0; left--) await press("guide-skip");
    expect(says("guide-instruction")).toBe("Nothing is recorded");
    expect(clips.at(-1)).toBeNull();
  });

  it("goes on after a reload, and opens no camera before it is asked to", async () => {
    const stored = { state: pass(beginGuide()), recordings: { face: { blob: new Blob(["x"]), fileName: "webcam.webm" } } };
    const { says, press, getUserMedia, store } = await setUp({ stored });
    expect(says("guide-instruction")).toBe("1 of 7 steps are recorded");
    expect(getUserMedia).not.toHaveBeenCalled();
    await press("guide-start");
    expect(getUserMedia).toHaveBeenCalledOnce();
    expect(says("guide-instruction")).toBe("Turn your head to the left");
    for (let left = 6; left > 0; left--) await press("guide-skip");
    await press("guide-restart");
    expect(store.forget).toHaveBeenCalled();
    expect(says("guide-instruction")).toBe("Sit or stand in front of the camera");
  });

  it("hands over the clip after a reload where every step is settled, without the camera", async () => {
    let state = pass(beginGuide());
    while (state.current !== null) state = skip(state);
    const recordings = { face: { blob: new Blob(["x"]), fileName: "webcam.webm" } };
    const { clips, says, press, getUserMedia } = await setUp({ stored: { state, recordings } });
    expect([clips.map((clip) => clip?.fileName), says("guide-instruction")]).toEqual([["webcam.webm"], "Your clip is ready"]);
    expect(getUserMedia).not.toHaveBeenCalled();
    await press("guide-restart");
    expect([clips.at(-1), says("guide-instruction")]).toEqual([null, "Sit or stand in front of the camera"]);
  });

  it("warns where a reload would cost everything", async () => {
    const { view, press } = await setUp({ isKept: false });
    await press("guide-start");
    await press("guide-skip");
    expect(view.element.textContent).toContain("This browser keeps no recordings");
  });

  it("is still to be had where nothing can be checked", async () => {
    const { press, says, clips, view } = await setUp();
    watched.hooks?.onFailed("no model");
    expect(view.element.textContent).toContain("The steps cannot be checked live: no model");
    await press("guide-start");
    expect(says("guide-words")).toMatch(/then press Done/);
    for (let left = 7; left > 0; left--) await press("guide-done");
    expect(clips.at(-1)?.fileName).toBe("webcam.zip");
  });

  it("says what to do where there is no camera, and tries again", async () => {
    const { view, getUserMedia, says } = await setUp({ open: () => Promise.reject(new DOMException("no", "NotFoundError")) });
    expect(view.element.textContent).toContain("No camera found");
    getUserMedia.mockImplementation(async () => ({ getTracks: () => [], getVideoTracks: () => [] }));
    view.element.querySelector("button")?.click();
    await settled();
    expect(says("guide-instruction")).toBe("Sit or stand in front of the camera");
  });

  it("keeps what was recorded where the camera is taken away", async () => {
    const { view, press, watch, track, says } = await setUp();
    await press("guide-start");
    await watch(DONE.face, 4000);
    track.dispatchEvent(new Event("ended"));
    expect(view.element.textContent).toContain("The camera was disconnected");
    expect(watched.ended).toBe(1);
    view.element.querySelector("button")?.click();
    await settled();
    await press("guide-start");
    expect(says("guide-instruction")).toBe("Turn your head to the left");
  });

  it("switches the camera off when it is closed, also one that opens late", async () => {
    const { view, track, press } = await setUp();
    await press("guide-start");
    view.close();
    expect(track.stopped).toBe(true);
    let opened: (stream: unknown) => void = () => undefined;
    const late = await setUp({ open: () => new Promise((resolve) => (opened = resolve)) });
    late.view.close();
    const lateTrack = new FakeTrack();
    opened({ getTracks: () => [lateTrack], getVideoTracks: () => [lateTrack] });
    await settled();
    expect(lateTrack.stopped).toBe(true);
  });
});
