import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Recolouring, type RecolouredRoom } from "../../src/recolouring/recolouring";
import type { LookTask, Recoloured } from "../../src/recolouring/worker";
import type { LaidPicture } from "../../src/splats/laid";
import { person, wall } from "./people";

class FakeWorker extends EventTarget {
  static made: FakeWorker[] = [];
  told: LookTask[] = [];
  terminate = vi.fn();
  constructor() {
    super();
    FakeWorker.made.push(this);
  }
  postMessage(task: LookTask): void {
    this.told.push(task);
  }
  answer(data: Recoloured): void {
    this.dispatchEvent(new MessageEvent("message", { data }));
  }
}

const LAID: LaidPicture = { detail: new Uint32Array(1), places: new Uint32Array(1), webcam: [0, 0, 1], focalPx: 300 };
const ADA = 0x8768;
const BO = 0x1234;

/** A packet about somebody; a frame, unless said otherwise. */
function packet(check: number, kind = 4): ArrayBuffer {
  const data = new DataView(new ArrayBuffer(kind === 6 ? 12 : 20));
  data.setUint8(0, 1);
  data.setUint8(1, kind);
  data.setUint16(4, check, true);
  return data.buffer as ArrayBuffer;
}
const end = (check: number): ArrayBuffer => packet(check, 6);

describe("Recolouring", () => {
  let here: { check: number; splats: ReturnType<typeof person> }[];
  let shown: number[][];
  /** Whose pictures are laid on them. */
  let laidOn: boolean[][];
  let room: { lays: boolean };
  let recolouring: Recolouring;

  const versionOf = (check: number): number =>
    Math.max(...FakeWorker.made[0]!.told.flatMap((task) => (task.person === check && "version" in task ? [task.version] : [])));
  /** The worker's answer of a picture of `momentMs`. */
  const answer = (check: number, value: number, momentMs = 0, version = versionOf(check)): void => {
    const count = here.find((one) => one.check === check)?.splats.count ?? 0;
    FakeWorker.made[0]?.answer({ person: check, version, changes: new Uint32Array(count).fill(value), momentMs, laid: LAID });
  };

  beforeEach(() => {
    vi.useFakeTimers({ toFake: ["performance"] });
    vi.stubGlobal("Worker", FakeWorker);
    FakeWorker.made = [];
    shown = [];
    laidOn = [];
    here = [
      { check: BO, splats: person(wall(1)) },
      { check: ADA, splats: person(wall(2)) },
    ];
    const drawn = {
      lays: true,
      get people() {
        return here.map(({ splats }) => splats);
      },
      indexOf: (check: number) => here.findIndex((one) => one.check === check),
      setChanges: (changes: Uint32Array, laid: readonly (LaidPicture | null)[]) => {
        shown.push([...changes]);
        laidOn.push(laid.map((one) => one === LAID));
      },
    } satisfies RecolouredRoom;
    room = drawn;
    recolouring = new Recolouring(() => drawn);
  });
  afterEach(() => {
    vi.unstubAllGlobals();
    vi.useRealTimers();
  });

  it("hands frames to a worker, which it first tells of the splats", () => {
    recolouring.accept(packet(ADA), 0);
    recolouring.accept(packet(ADA), 10);
    expect(FakeWorker.made).toHaveLength(1);
    expect(FakeWorker.made[0]?.told.map((task) => Object.keys(task))).toEqual([["person", "splats", "version"], ["person", "packet", "lays"], ["person", "packet", "lays"]]);
  });

  it("tells the worker whether this device lays pictures on people", () => {
    recolouring.accept(packet(ADA), 0);
    room.lays = false;
    recolouring.accept(packet(ADA), 10);
    expect(FakeWorker.made[0]?.told.flatMap((task) => ("lays" in task ? [task.lays] : []))).toEqual([true, false]);
  });

  it("lays pictures on whom they show, until the same moment as their changes", () => {
    recolouring.accept(packet(ADA), 0);
    recolouring.accept(packet(BO), 0);
    answer(ADA, 5);
    answer(BO, 6);
    recolouring.accept(end(BO), 20);
    recolouring.forget();
    expect(laidOn).toEqual([[false, true], [true, true], [false, true], [false, false]]);
    expect(shown.map((one) => one.some(Boolean))).toEqual([true, true, true, false]);
  });

  it("shows everybody's changes among everybody's splats", () => {
    recolouring.accept(packet(ADA), 0);
    recolouring.accept(packet(BO), 0);
    answer(ADA, 5);
    answer(BO, 6);
    expect(shown).toEqual([[0, 5, 5, 5, 5], [6, 5, 5, 5, 5]]);
  });

  it("ends at once, and takes no late answer", () => {
    recolouring.accept(packet(ADA), 0);
    answer(ADA, 5);
    recolouring.accept(end(ADA), 20);
    expect(shown.at(-1)).toEqual([0, 0, 0, 0, 0]);
    expect(FakeWorker.made[0]?.told.at(-1)).toEqual({ person: ADA, ended: true });
    const before = versionOf(ADA);
    answer(ADA, 5);
    recolouring.accept(packet(ADA), 30);
    answer(ADA, 5, 0, before);
    expect(shown).toHaveLength(2);
    answer(ADA, 7);
    expect(shown.at(-1)).toEqual([0, 7, 7, 7, 7]);
  });

  it("ends by itself where nothing is heard for a second", () => {
    recolouring.accept(packet(ADA), 0);
    answer(ADA, 5);
    recolouring.update(990);
    expect(shown).toHaveLength(1);
    recolouring.update(1010);
    expect(shown.at(-1)).toEqual([0, 0, 0, 0, 0]);
  });

  it("ends with the connection", () => {
    recolouring.accept(packet(ADA), 0);
    answer(ADA, 5);
    recolouring.forget();
    expect(shown.at(-1)).toEqual([0, 0, 0, 0, 0]);
  });

  it("begins anew with a better model, and shows nothing that was for another", () => {
    recolouring.accept(packet(ADA), 0);
    const before = versionOf(ADA);
    here[1] = { check: ADA, splats: person(wall(2)) };
    recolouring.accept(packet(ADA), 10);
    answer(ADA, 5, 0, before);
    expect(shown).toEqual([]);
    answer(ADA, 5);
    expect(shown).toHaveLength(1);
  });

  it("has nothing to do with people who are not drawn here", () => {
    recolouring.accept(packet(0x7777), 0);
    recolouring.accept(end(0x7777), 0);
    expect(FakeWorker.made).toEqual([]);
  });

  it("tells how late a picture is beside the poses of its moment, at most 0.3 s", () => {
    recolouring.accept(packet(ADA), 0);
    recolouring.notePose(50_000, 20);
    expect(recolouring.behindMs(ADA)).toBe(0);
    vi.advanceTimersByTime(200);
    answer(ADA, 5, 50_000 + performance.now() - 20 - 150);
    expect(recolouring.behindMs(ADA)).toBeCloseTo(150);
    for (let n = 0; n < 60; n++) answer(ADA, 5, 50_000 - 5000);
    expect(recolouring.behindMs(ADA)).toBeGreaterThan(290);
    expect(recolouring.behindMs(ADA)).toBeLessThanOrEqual(300);
    recolouring.accept(end(ADA), 400);
    expect(recolouring.behindMs(ADA)).toBe(0);
  });
});
