// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Channel } from "../../src/motion/channel";
import type { DetectorMessage } from "../../src/landmarks/detector";
import { MotionCapture } from "../../src/motion/motionCapture";
import type { Landmarks } from "../../src/landmarks/landmarks";
import { LONGEST_MOTION_BYTES, MOTION_BYTES } from "../../src/motion/motionPacket";
import type { SolverMessage, SolverTask } from "../../src/motion/solving";
import { BODY_PACKET } from "./bodyPacket";

const SEEN: Landmarks = {
  width: 640,
  height: 480,
  xy: new Float32Array(66).fill(0.5),
  world: new Float32Array(99),
  visibility: new Float32Array(33).fill(1),
};

class FakeTrack extends EventTarget {
  readyState = "live";
  stop(): void {
    this.readyState = "ended";
  }
}

class FakeWorker {
  static made: FakeWorker[] = [];
  onmessage: ((event: { data: DetectorMessage | SolverMessage }) => void) | null = null;
  onerror: ((event: { message: string }) => void) | null = null;
  given: { timeMs: number; look: boolean }[] = [];
  get solves(): boolean {
    return this.address.pathname.endsWith("/motion/worker.ts");
  }
  terminated = false;
  constructor(readonly address: URL) {
    FakeWorker.made.push(this);
  }
  postMessage(given: { timeMs: number; look: boolean } | SolverTask): void {
    if (!("kind" in given)) this.given.push(given);
    else if (given.kind === "seen") {
      const packet = new ArrayBuffer(given.liveLook ? LONGEST_MOTION_BYTES : MOTION_BYTES);
      new DataView(packet).setUint16(2, given.liveLook ? 0x8000 : 0, true);
      this.onmessage?.({ data: { kind: "solved", timeMs: given.timeMs, packet } });
    }
  }
  terminate(): void {
    this.terminated = true;
  }
}

let nextFrame: (nowMs: number) => void = () => undefined;
let bitmaps: Promise<unknown> = Promise.resolve();

async function setUp(connected = true) {
  const track = new FakeTrack();
  const stream = { active: true, getTracks: () => [track], getVideoTracks: () => [track] };
  const getUserMedia = vi.fn(async (_: MediaStreamConstraints) => stream);
  vi.stubGlobal("navigator", Object.assign(Object.create(navigator), { mediaDevices: { getUserMedia } }));
  const sent: ArrayBuffer[] = [];
  const channel: Channel = {
    binaryType: "blob",
    readyState: "open",
    bufferedAmount: 0,
    onmessage: null,
    send: (data) => {
      if (typeof data !== "string") sent.push(data.slice(0));
      else channel.onmessage?.(new MessageEvent("message", { data: BODY_PACKET }));
    },
    close: vi.fn(),
  };
  const link = { connected };
  const told: string[] = [];
  const problems: string[] = [];
  const landmarks: (Landmarks | null)[] = [];
  const capture = new MotionCapture(() => (link.connected ? channel : null), {
    onTracking: (tracking) => told.push(tracking),
    onLandmarks: (seen) => landmarks.push(seen),
    onProblem: ({ title }) => problems.push(title),
  });
  const start = async (): Promise<FakeWorker> => {
    await capture.start();
    FakeWorker.made.find(({ solves }) => solves)?.onmessage?.({ data: { kind: "ready" } });
    return FakeWorker.made[0] as FakeWorker;
  };
  /** The camera takes a picture at `nowMs`, and the detector finds what is `seen` in it. */
  const picture = async (worker: FakeWorker, nowMs: number, seen: Landmarks | null, look: ImageBitmap | null = null): Promise<void> => {
    nextFrame(nowMs);
    await bitmaps;
    await Promise.resolve();
    const timeMs = worker.given.at(-1)?.timeMs ?? 0;
    worker.onmessage?.({ data: { kind: "found", timeMs, seen, look } });
  };
  return { capture, start, picture, track, channel, link, sent, told, problems, landmarks, getUserMedia };
}

beforeEach(() => {
  FakeWorker.made = [];
  vi.stubGlobal("Worker", FakeWorker);
  vi.stubGlobal("createImageBitmap", () => (bitmaps = Promise.resolve({ close: () => undefined })));
  const video = HTMLVideoElement.prototype;
  video.play = async () => undefined;
  video.requestVideoFrameCallback = (callback) => {
    nextFrame = (nowMs) => callback(nowMs, {} as VideoFrameCallbackMetadata);
    return 1;
  };
  video.cancelVideoFrameCallback = () => (nextFrame = () => undefined);
  Object.defineProperty(HTMLMediaElement.prototype, "srcObject", { writable: true, value: null, configurable: true });
});
afterEach(() => vi.unstubAllGlobals());

describe("MotionCapture", () => {
  it("sends poses, and no picture, of whoever is in view", async () => {
    const { capture, start, picture, sent, told, landmarks } = await setUp();
    const worker = await start();
    worker.onmessage?.({ data: { kind: "ready" } });
    await picture(worker, 100, SEEN);
    expect(sent.map(({ byteLength }) => byteLength)).toEqual([MOTION_BYTES]);
    expect(told).toEqual(["starting", "tracking"]);
    expect(landmarks).toEqual([SEEN]);
    capture.close();
  });

  it("marks packets while live look is on, hands its pictures on, and tells of its end at once", async () => {
    const { capture, start, picture, sent } = await setUp();
    const worker = await start();
    worker.onmessage?.({ data: { kind: "ready" } });
    await picture(worker, 100, SEEN);
    const look = { close: vi.fn() } as unknown as ImageBitmap;
    const packetsBefore: number[] = [];
    capture.setLook((shown) => shown === look && packetsBefore.push(sent.length));
    await picture(worker, 140, SEEN, look);
    expect(packetsBefore).toEqual([2]);
    await picture(worker, 180, null);
    capture.setLook(null);
    const marked = sent.map((packet) => new DataView(packet).getUint16(2, true) >= 0x8000);
    expect(marked).toEqual([false, true, false]);
    // one that was drawn meanwhile goes nowhere
    await picture(worker, 220, SEEN, look);
    expect([packetsBefore.length, vi.mocked(look.close).mock.calls.length]).toEqual([1, 1]);
    expect(worker.given.map((one) => one.look)).toEqual([false, true, true, false]);
    capture.close();
  });

  it("says that nobody is in view after a while, not for a single picture", async () => {
    const { capture, start, picture, told } = await setUp();
    const worker = await start();
    worker.onmessage?.({ data: { kind: "ready" } });
    await picture(worker, 1000, SEEN);
    await picture(worker, 1300, null);
    expect(told.at(-1)).toBe("tracking");
    await picture(worker, 1700, null);
    expect(told.at(-1)).toBe("searching");
    await picture(worker, 1750, SEEN);
    expect(told.at(-1)).toBe("tracking");
    capture.close();
  });

  it("waits for the meeting, and goes on once it is connected", async () => {
    const { capture, start, picture, link, sent, told } = await setUp(false);
    const worker = await start();
    worker.onmessage?.({ data: { kind: "ready" } });
    await picture(worker, 100, SEEN);
    expect([told.at(-1), sent.length]).toEqual(["disconnected", 0]);
    link.connected = true;
    await picture(worker, 140, SEEN);
    expect([told.at(-1), sent.length]).toEqual(["tracking", 1]);
    capture.close();
  });

  it("gives the detector rising times, whatever the camera says", async () => {
    const { capture, start, picture } = await setUp();
    const worker = await start();
    worker.onmessage?.({ data: { kind: "ready" } });
    for (const nowMs of [100, 90, 90, 200]) await picture(worker, nowMs, SEEN);
    const times = worker.given.map(({ timeMs }) => timeMs);
    expect(times).toEqual([...new Set(times)].sort((a, b) => a - b));
    expect(times).toHaveLength(4);
    capture.close();
  });

  it("starts a worker for face and hands only once a body was found", async () => {
    const { capture, start, picture } = await setUp();
    const worker = await start();
    worker.onmessage?.({ data: { kind: "ready" } });
    await picture(worker, 100, null);
    expect(FakeWorker.made).toHaveLength(2);
    await picture(worker, 140, SEEN);
    expect(FakeWorker.made[2]?.address.pathname).toContain("expressionWorker");
    capture.close();
    expect(FakeWorker.made.every(({ terminated }) => terminated)).toBe(true);
  });

  it("ends with what to do where the camera is refused", async () => {
    const { start, problems, getUserMedia } = await setUp();
    getUserMedia.mockRejectedValueOnce(new DOMException("no", "NotAllowedError"));
    await start();
    expect(problems).toEqual(["The camera is blocked"]);
    expect(FakeWorker.made).toEqual([]);
  });

  it("ends where the camera is unplugged, the detector fails, or the server refuses", async () => {
    const ends: [string, (made: Awaited<ReturnType<typeof setUp>>, worker: FakeWorker) => void][] = [
      ["The camera was disconnected", ({ track }) => track.dispatchEvent(new Event("ended"))],
      ["Motion capture failed", (_, worker) => worker.onmessage?.({ data: { kind: "failed", reason: "no model" } })],
      ["Motion capture failed", (_, worker) => worker.onerror?.({ message: "no such file" })],
      ["Not yours", ({ channel }) => channel.onmessage?.(new MessageEvent("message", { data: '{"title":"Not yours","status":403}' }))],
    ];
    for (const [title, end] of ends) {
      FakeWorker.made = [];
      const made = await setUp();
      const worker = await made.start();
      worker.onmessage?.({ data: { kind: "ready" } });
      await made.picture(worker, 100, SEEN);
      end(made, worker);
      end(made, worker);
      expect(made.problems).toEqual([title]);
      expect(made.track.readyState).toBe("ended");
      expect(worker.terminated).toBe(true);
    }
  });

  it("switches a camera off that opens after it was closed", async () => {
    const { capture, track, getUserMedia } = await setUp();
    let open: (stream: unknown) => void = () => undefined;
    getUserMedia.mockImplementationOnce(() => new Promise((resolve) => (open = resolve as never)));
    const starting = capture.start();
    capture.close();
    open({ active: true, getTracks: () => [track], getVideoTracks: () => [track] });
    await starting;
    expect(track.readyState).toBe("ended");
    expect(FakeWorker.made).toEqual([]);
    expect(capture.camera).toBeNull();
  });
});
