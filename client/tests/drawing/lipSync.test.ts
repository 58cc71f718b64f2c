import { describe, expect, it } from "vitest";
import { LipSync } from "../../src/drawing/lipSync";
import { POSE_BYTES } from "../../src/transport/packets";

/** 30 a second. */
const STEP_MS = 1000 / 30;

/** A pose of the performer at a place of the roster, whose picture was so old when it left. */
function pose(index: number, sequence: number, ageMs: number): ArrayBuffer {
  const bytes = new ArrayBuffer(POSE_BYTES);
  const data = new DataView(bytes);
  data.setUint8(0, 1);
  data.setUint8(1, 2);
  data.setUint16(2, ageMs, true);
  data.setUint32(4, sequence, true);
  data.setUint8(16, index);
  return bytes;
}

function setUp(voices: (number | null)[], lookMs: () => number = () => 0) {
  const shown: { index: number; sequence: number; atMs: number }[] = [];
  let nowMs = 0;
  const sync = new LipSync(
    (index) => voices[index] ?? null,
    (packet) => {
      const data = new DataView(packet);
      shown.push({ index: data.getUint8(16), sequence: data.getUint32(4, true), atMs: nowMs });
    },
    lookMs,
  );
  const sentMs = new Map<number, number>();
  let sequence = 0;
  /** Poses of everybody come for so long, the page looks every few ms, and a picture takes `drawingMs`. */
  const run = (seconds: number, ageMs = 1, drawingMs = 0): void => {
    for (const endMs = nowMs + 1000 * seconds; nowMs < endMs; nowMs += STEP_MS) {
      sequence += 1;
      sentMs.set(sequence, nowMs);
      voices.forEach((_, index) => sync.accept(pose(index, sequence, ageMs), nowMs));
      const cameMs = nowMs;
      for (let tick = 1; tick < 8; tick++) {
        nowMs = cameMs + (tick * STEP_MS) / 8;
        sync.advance(nowMs);
        sync.submitted();
        sync.finished(nowMs + drawingMs);
      }
      nowMs = cameMs;
    }
  };
  /** How late each pose was shown. */
  const lateMs = (index = 0): number[] =>
    shown.filter((one) => one.index === index).map((one) => one.atMs - (sentMs.get(one.sequence) ?? NaN));
  return { voices, shown, sync, run, lateMs };
}

describe("LipSync", () => {
  it("holds motion back as long as its live look is late, and no longer, where the voice is not later still", () => {
    let look = 180;
    const { run, lateMs, voices } = setUp([null], () => look);
    run(4);
    expect(lateMs().at(-1)).toBeGreaterThan(170);
    expect(lateMs().at(-1)).toBeLessThan(190);
    voices[0] = 240;
    run(4);
    expect(lateMs().at(-1)).toBeGreaterThan(225);
    [voices[0], look] = [null, 0];
    run(4);
    expect(lateMs().at(-1)).toBe(0);
  });

  it("shows poses at once where nobody is heard", () => {
    const { run, lateMs, shown } = setUp([null]);
    run(3);
    expect(Math.max(...lateMs())).toBe(0);
    expect(shown).toHaveLength(90);
  });

  it("holds a performer's poses as long as their voice is later, and nobody else's", () => {
    const { run, lateMs } = setUp([101, null]);
    run(4);
    expect(lateMs(0).at(-1)).toBeGreaterThan(90);
    expect(lateMs(0).at(-1)).toBeLessThan(105);
    expect(Math.max(...lateMs(1))).toBe(0);
  });

  it.each([[60, 0], [0.5, 60]])("holds by so much less as finding the landmarks and drawing take", (ageMs, drawingMs) => {
    const { run, lateMs } = setUp([101]);
    run(6, Math.ceil(ageMs), drawingMs);
    expect(lateMs().at(-1)).toBeGreaterThan(30);
    expect(lateMs().at(-1)).toBeLessThan(45);
  });

  it("counts of a page that draws rarely what its poses wait for a picture in the mean", () => {
    const { sync, voices, shown } = setUp([null]);
    for (let picture = 1; picture <= 200; picture++) {
      const endMs = 120 * picture;
      for (const cameMs of [endMs - 100, endMs - 60, endMs - 20]) sync.accept(pose(0, picture, 1), cameMs);
      sync.submitted();
      sync.submitted(); // the same poses, drawn once more
      sync.finished(endMs);
      sync.finished(endMs + 50);
    }
    voices[0] = 100;
    let cameMs = 24_000;
    for (; cameMs < 26_000; cameMs += 40) sync.accept(pose(0, 500, 1), cameMs);
    sync.advance(cameMs);
    const before = shown.length;
    sync.accept(pose(0, 501, 1), cameMs);
    // 100 less the millisecond that finding took and 60
    sync.advance(cameMs + 38);
    expect(shown).toHaveLength(before);
    sync.advance(cameMs + 40);
    expect(shown).toHaveLength(before + 1);
  });

  it("never hastens lips that are late already", () => {
    const { run, lateMs } = setUp([70]);
    run(4, 72);
    expect(Math.max(...lateMs())).toBe(0);
  });

  it("comes into step smoothly, and gives way smoothly once the voice ends", () => {
    const { voices, run, lateMs, shown } = setUp([200]);
    run(4);
    voices[0] = null;
    run(4);
    const late = lateMs();
    expect(late[0]).toBe(0);
    expect(late.at(-1)).toBe(0);
    const changes = late.slice(1).map((ms, i) => Math.abs(ms - (late[i] ?? 0)));
    // a tenth of the time between two poses, and the page draws every eighth of it
    expect(Math.max(...changes)).toBeLessThanOrEqual(STEP_MS / 10 + STEP_MS / 8 + 0.1);
    expect(shown.map(({ sequence }) => sequence)).toEqual([...shown.keys()].map((i) => i + 1));
  });

  it("does not wait for a voice that is hopelessly late", () => {
    const { run, lateMs } = setUp([2000]);
    run(6);
    expect(Math.max(...lateMs())).toBeLessThan(255);
  });

  it("holds nobody who follows no landmarks", () => {
    const { run, lateMs } = setUp([200]);
    run(3, 0);
    expect(Math.max(...lateMs())).toBe(0);
  });

  it("forgets what waits when the connection is another", () => {
    const { run, sync, shown } = setUp([200]);
    run(3);
    const before = shown.length;
    sync.forget();
    sync.advance(1e9);
    expect(shown).toHaveLength(before);
  });

  it("shows nothing that is no pose", () => {
    const { sync, shown } = setUp([null]);
    sync.accept(new ArrayBuffer(3), 0);
    sync.accept(new ArrayBuffer(POSE_BYTES), 0);
    expect(shown).toEqual([]);
  });
});
