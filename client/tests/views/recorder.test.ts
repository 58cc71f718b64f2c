// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Clip } from "../../src/enrolment/enrol";
import { COUNTDOWN_S, TURN_S } from "../../src/capture/record";
import { recorder } from "../../src/views/recorder";

class FakeTrack extends EventTarget {
  stopped = false;
  stop(): void {
    this.stopped = true;
  }
}

class FakeRecorder {
  static made: FakeRecorder[] = [];
  static isTypeSupported = (type: string): boolean => type.startsWith("video/webm");
  state = "inactive";
  ondataavailable: (event: { data: Blob }) => void = () => undefined;
  onstop: () => void = () => undefined;
  onerror: () => void = () => undefined;
  constructor(
    _: unknown,
    readonly options: MediaRecorderOptions,
  ) {
    FakeRecorder.made.push(this);
  }
  start(): void {
    this.state = "recording";
  }
  stop(): void {
    this.state = "inactive";
    this.ondataavailable({ data: new Blob(["pictures"]) });
    this.onstop();
  }
}

let close: () => void = () => undefined;

async function setUp(open?: () => Promise<unknown>) {
  const track = new FakeTrack();
  const stream = { getTracks: () => [track], getVideoTracks: () => [track] };
  const getUserMedia = vi.fn(open ?? (async () => stream));
  vi.stubGlobal("navigator", Object.assign(Object.create(navigator), { mediaDevices: { getUserMedia } }));
  const clips: (Clip | null)[] = [];
  const view = recorder((clip) => clips.push(clip));
  close = view.close;
  const button = (label: string): HTMLButtonElement => {
    const found = [...view.element.querySelectorAll("button")].find(({ textContent }) => textContent === label);
    if (!found) throw new Error(`no button “${label}” in “${view.element.textContent}”`);
    return found;
  };
  const words = (): string => view.element.querySelector(".instruction")?.textContent ?? "";
  await vi.advanceTimersByTimeAsync(0);
  return { view, clips, button, words, track, getUserMedia };
}

beforeEach(() => {
  vi.useFakeTimers();
  FakeRecorder.made = [];
  vi.stubGlobal("MediaRecorder", FakeRecorder);
  Object.defineProperty(HTMLMediaElement.prototype, "srcObject", { writable: true, value: null, configurable: true });
  HTMLMediaElement.prototype.play = async () => undefined;
});
afterEach(() => {
  close();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("recording oneself", () => {
  it("counts down, guides through one turn, and gives the clip", async () => {
    const { button, words, clips } = await setUp();
    expect(words()).toBe("Step back until your whole body is in view");
    button("Start recording").click();
    expect(words()).toBe("Recording starts in 5");
    await vi.advanceTimersByTimeAsync(1000);
    expect(words()).toBe("Recording starts in 4");
    expect(FakeRecorder.made).toEqual([]);
    await vi.advanceTimersByTimeAsync(1000 * (COUNTDOWN_S - 1) + 200);
    expect(words()).toBe("Face the camera");
    await vi.advanceTimersByTimeAsync(500 * TURN_S);
    expect(words()).toBe("Keep turning, nice and slow");
    await vi.advanceTimersByTimeAsync(500 * TURN_S);
    const clip = clips.at(-1);
    expect(clip?.fileName).toBe("webcam.webm");
    expect(await clip?.blob.text()).toBe("pictures");
    expect(clip?.blob.type).toBe("video/webm");
    button("Record again").click();
    expect(clips.at(-1)).toBeNull();
    expect(words()).toBe("Step back until your whole body is in view");
  });

  it("begins anew where it is stopped, in the countdown or in the turn", async () => {
    const { button, words, clips } = await setUp();
    for (const afterS of [2, COUNTDOWN_S + 3]) {
      button("Start recording").click();
      await vi.advanceTimersByTimeAsync(1000 * afterS);
      button("Stop").click();
      await vi.advanceTimersByTimeAsync(0);
      expect(words()).toBe("Step back until your whole body is in view");
    }
    await vi.advanceTimersByTimeAsync(60_000);
    expect(clips.every((clip) => clip === null)).toBe(true);
  });

  it("says what to do where there is no camera, and tries again", async () => {
    const { view, button, words, getUserMedia } = await setUp(() => Promise.reject(new DOMException("no", "NotFoundError")));
    expect(view.element.textContent).toContain("No camera found");
    getUserMedia.mockImplementation(async () => ({ getTracks: () => [], getVideoTracks: () => [] }));
    button("Try again").click();
    await vi.advanceTimersByTimeAsync(0);
    expect(words()).toBe("Step back until your whole body is in view");
  });

  it("says so where the camera is taken away in the turn, and gives no clip", async () => {
    const { view, button, track, clips } = await setUp();
    button("Start recording").click();
    await vi.advanceTimersByTimeAsync(1000 * (COUNTDOWN_S + 3));
    track.dispatchEvent(new Event("ended"));
    await vi.advanceTimersByTimeAsync(60_000);
    expect(view.element.textContent).toContain("The camera was disconnected");
    expect(clips.every((clip) => clip === null)).toBe(true);
  });

  it("switches the camera off when it is closed, also one that opens late", async () => {
    const { view, track, button } = await setUp();
    button("Start recording").click();
    await vi.advanceTimersByTimeAsync(1000 * (COUNTDOWN_S + 1));
    view.close();
    expect(track.stopped).toBe(true);
    expect(FakeRecorder.made[0]?.state).toBe("inactive");

    let open: (stream: unknown) => void = () => undefined;
    const late = await setUp(() => new Promise((resolve) => (open = resolve)));
    late.view.close();
    const lateTrack = new FakeTrack();
    open({ getTracks: () => [lateTrack], getVideoTracks: () => [lateTrack] });
    await vi.advanceTimersByTimeAsync(0);
    expect(lateTrack.stopped).toBe(true);
  });
});
