import { describe, expect, it } from "vitest";
import { LandmarkDetector, type DetectorMessage, type DetectorWorker, type Picture } from "../../src/landmarks/detector";
import { LANDMARK_COUNT, type Landmarks } from "../../src/landmarks/landmarks";
import { skeletonLines } from "../../src/landmarks/skeleton";

function somebody(): Landmarks {
  return {
    width: 640,
    height: 480,
    xy: new Float32Array(2 * LANDMARK_COUNT).fill(0.5),
    world: new Float32Array(3 * LANDMARK_COUNT),
    visibility: new Float32Array(LANDMARK_COUNT).fill(1),
  };
}

class FakeWorker implements DetectorWorker {
  onmessage: DetectorWorker["onmessage"] = null;
  onerror: DetectorWorker["onerror"] = null;
  pictures: Picture[] = [];
  ended = false;
  postMessage = (picture: Picture): void => void this.pictures.push(picture);
  terminate = (): void => void (this.ended = true);
  say = (answer: DetectorMessage): void => this.onmessage?.({ data: answer } as MessageEvent<DetectorMessage>);
}

const settled = (): Promise<void> => new Promise((resolve) => setTimeout(resolve));

describe("LandmarkDetector", () => {
  function setUp(grab = async (): Promise<ImageBitmap> => ({}) as ImageBitmap) {
    const worker = new FakeWorker();
    const found: unknown[] = [];
    const hooks = {
      onFound: (...one: unknown[]) => void found.push(one),
      onFailed: (reason: string) => void found.push(reason),
    };
    return { worker, found, finder: new LandmarkDetector(grab, hooks, worker) };
  }

  it("gives the worker one picture at a time, and the newest when it is done", async () => {
    const { worker, found, finder } = setUp();
    finder.offer(1);
    await settled();
    expect(worker.pictures).toEqual([]); // not ready yet
    worker.say({ kind: "ready" });
    await settled();
    for (const time of [2, 3, 4]) finder.offer(time);
    expect(worker.pictures.map(({ timeMs }) => timeMs)).toEqual([1]);
    worker.say({ kind: "found", timeMs: 1, seen: null, look: null });
    await settled();
    expect(worker.pictures.map(({ timeMs }) => timeMs)).toEqual([1, 4]);
    expect(found).toEqual([[null, 1, null]]);
  });

  it("says with each picture whether the person is to be cut out, and hands on what was", async () => {
    const { worker, found, finder } = setUp();
    worker.say({ kind: "ready" });
    finder.offer(1);
    await settled();
    finder.look = true;
    const look = {} as ImageBitmap;
    worker.say({ kind: "found", timeMs: 1, seen: null, look });
    finder.offer(2);
    await settled();
    expect(worker.pictures.map((one) => one.look)).toEqual([false, true]);
    expect(found).toEqual([[null, 1, look]]);
  });

  it("waits for the next picture where the camera has none", async () => {
    let broken = true;
    const { worker, finder } = setUp(async () => {
      if (broken) throw new DOMException("no picture", "InvalidStateError");
      return {} as ImageBitmap;
    });
    worker.say({ kind: "ready" });
    finder.offer(1);
    await settled();
    broken = false;
    finder.offer(2);
    await settled();
    expect(worker.pictures.map(({ timeMs }) => timeMs)).toEqual([2]);
  });

  it("tells of a failure, and is silent once it is closed", () => {
    const { worker, found, finder } = setUp();
    worker.say({ kind: "failed", reason: "no model" });
    expect(found).toEqual(["no model"]);
    finder.close();
    worker.say({ kind: "found", timeMs: 1, seen: null, look: null });
    expect(found).toHaveLength(1);
    expect(worker.ended).toBe(true);
  });
});

describe("skeletonLines", () => {
  it("shows what is seen and leaves out what is guessed", () => {
    const seen = somebody();
    seen.xy.set([0.25, 0.5], 2 * 11);
    expect(skeletonLines(seen, 640, 480).lines).toHaveLength(16);
    expect(skeletonLines(seen, 640, 480).lines[0]?.from).toEqual([160, 240]);
    seen.visibility.fill(0.2, 23); // hips and legs
    expect(skeletonLines(seen, 640, 480).lines).toHaveLength(7);
    seen.visibility.fill(0, 0, 11);
    expect(skeletonLines(seen, 640, 480).points).toEqual([]);
  });
});
