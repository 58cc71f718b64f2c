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

function setUp(voices: (number | null)[]) {
  const shown: { index: number; sequence: number; atMs: number }[] = [];
  let nowMs = 0;
  const sync = new LipSync(
    (index) => voices[index] ?? null,
    (packet) => {
      const data = new DataView(packet);
      shown.push({ index: data.getUint8(16), sequence: data.getUint32(4, true), atMs: nowMs });
    },
  );
  const sentMs = new Map<number, number>();
  let sequence = 0;
  /** Poses of everybody come for so long, and the page draws every few ms. */
  const run = (seconds: number, ageMs = 1): void => {
    for (const endMs = nowMs + 1000 * seconds; nowMs < endMs; nowMs += STEP_MS) {
      sequence += 1;
      sentMs.set(sequence, nowMs);
      voices.forEach((_, index) => sync.accept(pose(index, sequence, ageMs), nowMs));
      const cameMs = nowMs;
      for (let tick = 1; tick < 8; tick++) {
        nowMs = cameMs + (tick * STEP_MS) / 8;
        sync.advance(nowMs);
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
  it("shows poses at once where nobody is heard", () => {
    const { run, lateMs, shown } = setUp([null]);
    run(3);
    expect(Math.max(...lateMs())).toBe(0);
    expect(shown).toHaveLength(90);
  });

  it("holds a performer's poses as long as their voice is later, and nobody else's", () => {
    const { run, lateMs } = setUp([145, null]);
    run(4);
    // 145 less the millisecond that finding took and 45 that lips take anyway, seen every few ms
    expect(lateMs(0).at(-1)).toBeGreaterThanOrEqual(99);
    expect(lateMs(0).at(-1)).toBeLessThan(105);
    expect(Math.max(...lateMs(1))).toBe(0);
  });

  it("holds by so much less as finding the landmarks took", () => {
    const { run, lateMs } = setUp([145]);
    run(4, 60);
    expect(lateMs().at(-1)).toBeGreaterThanOrEqual(40);
    expect(lateMs().at(-1)).toBeLessThan(46);
  });

  it("never hastens lips that are late already", () => {
    const { run, lateMs } = setUp([80]);
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
