import { describe, expect, it } from "vitest";
import { Pacer, StallDetector, VIEW_BYTES, decodePose, encodeView, isNewer, performerCheck, poseHead, posesIn } from "../../src/transport/packets";

describe("encodeView", () => {
  it("writes the very bytes that the server's own encoder writes", () => {
    const bytes = encodeView({
      sequence: 0x80000001,
      captureTimeMs: 1234567.125,
      position: [0.5, -1.25, 3],
      wxyz: [0.5, -0.5, 0.5, -0.5],
      fovYRad: 0.75,
      width: 1024,
      height: 576,
      hideUnseen: false,
      rendersLocally: false,
      stalled: false,
      audioOnly: false, posesToo: false,
    });
    expect(bytes.byteLength).toBe(VIEW_BYTES);
    const hex = [...new Uint8Array(bytes)].map((byte) => byte.toString(16).padStart(2, "0"));
    expect(hex.join("")).toBe(
      "01030000" + // version 1, kind 3 (view), no flags
        "01000080" + // sequence
        "00000020" + "87d63241" + // capture time
        "0000003f" + "0000a0bf" + "00004040" + // position
        "0000003f" + "000000bf" + "0000003f" + "000000bf" + // quaternion
        "0000403f" + // field of view
        "0004" + "4002", // size
    );
  });

  it("asks for what was filmed alone by the first bit of the flags", () => {
    const packet = { sequence: 1, captureTimeMs: 0, fovYRad: 0.6, width: 16, height: 16 };
    const bytes = encodeView({ ...packet, position: [0, 0, 0], wxyz: [1, 0, 0, 0], hideUnseen: true, rendersLocally: false, stalled: false, audioOnly: false, posesToo: false });
    expect([...new Uint8Array(bytes)].slice(0, 4)).toEqual([1, 3, 1, 0]);
  });

  it("asks for poses in place of pictures by the second", () => {
    const packet = { sequence: 1, captureTimeMs: 0, fovYRad: 0.6, width: 16, height: 16 };
    const bytes = encodeView({ ...packet, position: [0, 0, 0], wxyz: [1, 0, 0, 0], hideUnseen: false, rendersLocally: true, stalled: false, audioOnly: false, posesToo: false });
    expect([...new Uint8Array(bytes)].slice(0, 4)).toEqual([1, 3, 2, 0]);
  });

  it("says by the third that pictures have stopped", () => {
    const packet = { sequence: 1, captureTimeMs: 0, fovYRad: 0.6, width: 16, height: 16 };
    const bytes = encodeView({ ...packet, position: [0, 0, 0], wxyz: [1, 0, 0, 0], hideUnseen: false, rendersLocally: false, stalled: true, audioOnly: false, posesToo: false });
    expect([...new Uint8Array(bytes)].slice(0, 4)).toEqual([1, 3, 4, 0]);
  });
});

describe("encodeView on a line that is too slow", () => {
  it("asks by the fourth bit for audio only", () => {
    const packet = { sequence: 1, captureTimeMs: 0, fovYRad: 0.6, width: 16, height: 16 };
    const bytes = encodeView({ ...packet, position: [0, 0, 0], wxyz: [1, 0, 0, 0], hideUnseen: false, rendersLocally: true, stalled: false, audioOnly: true, posesToo: false });
    expect([...new Uint8Array(bytes)].slice(0, 4)).toEqual([1, 3, 10, 0]);
  });
});

describe("encodeView with a picture of oneself", () => {
  it("asks by the fifth bit for poses beside pictures", () => {
    const packet = { sequence: 1, captureTimeMs: 0, fovYRad: 0.6, width: 16, height: 16 };
    const bytes = encodeView({ ...packet, position: [0, 0, 0], wxyz: [1, 0, 0, 0], hideUnseen: false, rendersLocally: false, stalled: false, audioOnly: false, posesToo: true });
    expect([...new Uint8Array(bytes)].slice(0, 4)).toEqual([1, 3, 16, 0]);
  });
});

describe("StallDetector", () => {
  it("notices when pictures stop, once there have been some", () => {
    const watch = new StallDetector();
    expect(watch.stalled(10_000)).toBe(false);
    watch.shown(10_000);
    expect(watch.stalled(10_240)).toBe(false);
    expect(watch.stalled(10_260)).toBe(true);
    watch.shown(10_270);
    expect(watch.stalled(10_300)).toBe(false);
    watch.pause();
    expect(watch.stalled(99_999)).toBe(false);
  });
});

describe("decodePose", () => {
  // tests/services/live/test_pose_feed.py holds the server to the same bytes
  const golden =
    "01020000" + "07000000" + "0000000000709740" + "01036887" + "0000003f" + "0000803f" + "000000c0" +
    "b6b6ed6d5b6b" + "004000200010".repeat(23);
  const bytes = (hex: string): ArrayBuffer =>
    Uint8Array.from(hex.match(/../g) ?? [], (pair) => parseInt(pair, 16)).buffer;

  it("tells whose pose it is, and how old its landmarks were", () => {
    expect(poseHead(bytes(golden))).toEqual({ index: 1, check: 0x8768, captureTimeMs: 1500, ageMs: null });
    expect(poseHead(bytes("01024800" + golden.slice(8)))).toMatchObject({ index: 1, ageMs: 72 });
    expect(poseHead(bytes("0103" + golden.slice(4)))).toBeNull();
    expect(poseHead(bytes(golden).slice(1))).toBeNull();
  });

  it("reads the very bytes that the server writes", () => {
    const pose = decodePose(bytes(golden));
    expect(pose).toMatchObject({ sequence: 7, captureTimeMs: 1500, index: 1, count: 3, pelvis: [0.5, 1, -2] });
    expect(pose?.check).toBe(performerCheck("ada"));
    const turns = pose?.rotations ?? [];
    const length = Math.hypot(0.1, 0.3, 0.2, 0.9);
    // of the same turn's two quaternions the one whose largest component is positive
    [-0.1, 0.3, -0.2, 0.9].forEach((value, i) => expect(turns[i]).toBeCloseTo(value / length, 4));
    [1, 0, 0, 0].forEach((value, i) => expect(turns[4 + i]).toBeCloseTo(value, 4));
  });

  it("reads what face and hands do, and rest where nothing is said", () => {
    const shown = [0.2, 1, 0, 0.4, ...Array<number>(12).fill(0), 0.6];
    const moved = decodePose(bytes(golden + "33ff0066" + "00".repeat(12) + "9907"));
    expect([...(moved?.expression ?? [])]).toEqual(shown.map((v) => expect.closeTo(v, 6)));
    expect(moved?.rotations).toEqual(decodePose(bytes(golden))?.rotations);
    expect([...(decodePose(bytes(golden))?.expression ?? [])]).toEqual(Array<number>(17).fill(0));
  });

  it("reads an earlier version's recordings: a hand's curl is that of each of its fingers", () => {
    const moved = decodePose(bytes(golden + "33ff0066003399" + "07"));
    const eyes = Array<number>(2).fill(0);
    const shown = [0.2, 1, 0, 0.4, 0, ...eyes, ...Array<number>(5).fill(0.2), ...Array<number>(5).fill(0.6)];
    expect([...(moved?.expression ?? [])]).toEqual(shown.map((v) => expect.closeTo(v, 6)));
    const eyeless = decodePose(bytes(golden + "33ff006600" + "00".repeat(9) + "99" + "07"));
    const straight = [0.2, 1, 0, 0.4, 0, ...eyes, ...Array<number>(9).fill(0), 0.6];
    expect([...(eyeless?.expression ?? [])]).toEqual(straight.map((v) => expect.closeTo(v, 6)));
  });

  it("finds the poses of a batch, as the server writes it, and the one that comes alone", () => {
    const [first, second] = [golden, "01020000" + "08000000" + golden.slice(16)].map(bytes);
    const batch = bytes("0107" + "b0" + golden + "b0" + "01020000" + "08000000" + golden.slice(16));
    expect(posesIn(batch)).toEqual([first, second]);
    expect(posesIn(batch.slice(0, -1))).toEqual([first]);
    expect(posesIn(bytes("0107"))).toEqual([]);
    expect(posesIn(bytes(golden))).toEqual([first]);
  });

  it("takes nothing else for a pose", () => {
    expect(decodePose(bytes(golden.slice(2)))).toBeNull();
    expect(decodePose(bytes("0103" + golden.slice(4)))).toBeNull();
    expect(decodePose(new ArrayBuffer(0))).toBeNull();
  });
});

describe("isNewer", () => {
  it("holds across the wrap", () => {
    expect(isNewer(1, 0)).toBe(true);
    expect(isNewer(0, 0xffffffff)).toBe(true);
    expect(isNewer(0xffffffff, 0)).toBe(false);
    expect(isNewer(5, 5)).toBe(false);
  });
});

describe("Pacer", () => {
  const sent = (pacer: Pacer, times: number[], changed: boolean): number =>
    times.filter((ms) => pacer.due(ms, changed)).length;
  const ticks = (hertz: number, seconds: number): number[] =>
    Array.from({ length: hertz * seconds }, (_, i) => (i * 1000) / hertz);

  it("sends every tick of a 60 Hz screen, but no more than 60 a second on a 240 Hz screen", () => {
    expect(sent(new Pacer(), ticks(60, 2), true)).toBe(120);
    const fast = sent(new Pacer(), ticks(240, 2), true);
    expect(fast).toBeGreaterThan(110);
    expect(fast).toBeLessThanOrEqual(122);
  });

  it("keeps a resting view alive at least twice a second, and no more than need be", () => {
    const resting = sent(new Pacer(), ticks(60, 4), false);
    expect(resting).toBeGreaterThanOrEqual(8);
    expect(resting).toBeLessThanOrEqual(11);
  });

  it("does not lose a change that comes too early to be sent", () => {
    const pacer = new Pacer();
    expect(pacer.due(0, true)).toBe(true);
    expect(pacer.due(3, true)).toBe(false);
    expect(pacer.due(20, false)).toBe(true);
    expect(pacer.due(40, false)).toBe(false);
  });
});
