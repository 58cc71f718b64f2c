import { describe, expect, it } from "vitest";
import motion from "../../../tests/services/live/motion.json";
import { LONGEST_MOTION_BYTES, MOTION_BYTES, encodeMotion, stampMotion, withoutLook } from "../../src/motion/motionPacket";
import type { SolvedMotion } from "../../src/motion/motionSolver";
import { rotationsBy } from "../../src/motion/rotations";

const TOLD = motion.cases.flatMap(({ frames }) => frames.flatMap((frame) => (frame.motion?.more ? [frame] : [])));
type Told = (typeof TOLD)[number];

const numbers = (values: readonly number[]): Float64Array => Float64Array.from(values);
const hex = (bytes: ArrayBuffer): string => [...new Uint8Array(bytes)].map((byte) => byte.toString(16).padStart(2, "0")).join("");

function motionOf({ motion: told, time_ms, width, height }: Told): SolvedMotion {
  const { more, local, root, locked, expression } = told!;
  return {
    timeMs: time_ms,
    now: { local: rotationsBy(numbers(local)), root: numbers(root) },
    ahead: numbers(more!.ahead),
    aheadRoot: numbers(more!.ahead_root),
    locked,
    expression: numbers(expression),
    seen: { local: rotationsBy(numbers(more!.seen)), root: numbers(more!.seen_root) },
    width,
    height,
  };
}

describe("encodeMotion", () => {
  it("writes the very bytes that the server's own encoder writes", () => {
    expect(TOLD.length).toBeGreaterThan(20);
    for (const one of TOLD) {
      const packet = encodeMotion(motionOf(one), true);
      stampMotion(packet, 7, 72);
      expect(packet.byteLength).toBe(LONGEST_MOTION_BYTES);
      expect(hex(packet)).toBe(one.motion!.more!.packet);
    }
  });

  it("leaves out where they were in the picture while live look is off", () => {
    const [one] = TOLD as [Told];
    const short = encodeMotion(motionOf(one), false);
    expect(short.byteLength).toBe(MOTION_BYTES);
    expect(hex(withoutLook(encodeMotion(motionOf(one), true)))).toBe(hex(short));
    stampMotion(short, 1, 1e9);
    expect(new DataView(short).getUint16(2, true)).toBe(0x7fff);
  });

  it("tells somebody who does not move at all", () => {
    const still = motionOf(TOLD[0]!);
    still.ahead.fill(0);
    const bytes = new Uint8Array(encodeMotion(still, false));
    expect(bytes.subarray(188, 260).every((turn) => turn === 0)).toBe(true);
  });
});
