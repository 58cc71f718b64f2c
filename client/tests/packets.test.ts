import { describe, expect, it } from "vitest";
import { Pacer, VIEW_BYTES, encodeView } from "../src/packets";

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
    const bytes = encodeView({ ...packet, position: [0, 0, 0], wxyz: [1, 0, 0, 0], hideUnseen: true });
    expect([...new Uint8Array(bytes)].slice(0, 4)).toEqual([1, 3, 1, 0]);
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
