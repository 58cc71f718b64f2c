import { describe, expect, it } from "vitest";
import { FACE, LEFT_HAND } from "../../src/landmarks/expression";
import { KEYPOINTS_BYTES, LANDMARK_COUNT, LONGEST_KEYPOINTS_BYTES, encodeKeypoints } from "../../src/landmarks/packet";

/** What the server's own encoder writes of `somebody` (tests/services/live/test_keypoints_packet.py). */
const GOLDEN =
  "020148000700000000000000007097408002e001000c001800180018003000182aabfc05040800200080000002000800" +
  "2000800000020008002000d5fcabac42f5dfbf7ffffefdfbf7efdfbf7ffffefdfb0780aaba7ffffefdfbf7efdfbf7fff" +
  "fefdfbf7efdfbf7fff2aadd22aadd22aadd22aadd22aadd2beeffbbeeffbbeeffbbe4fcc35400334bad2e84aa32b8dae" +
  "34bad2e84aa32b8dae34bad2e8eafbbeeffbbeeff32b91fb44bf12bfeffbbeeffbbeeffb0e0000000000000000000000" +
  "04";
const GOLDEN_EXPRESSION = "d4fc40f60326000000000000200f";

function nobody() {
  return {
    width: 640,
    height: 480,
    xy: new Float32Array(2 * LANDMARK_COUNT),
    world: new Float32Array(3 * LANDMARK_COUNT),
    visibility: new Float32Array(LANDMARK_COUNT),
  };
}

function somebody() {
  const seen = nobody();
  const xy = { 0: [0.5, 0.25], 11: [0.75, 0.375], 28: [0.25, 1.5], 31: [0.125, 1.25] };
  const world = { 0: [0.125, -0.5, 0.25], 16: [-0.75, 0.25, -0.0625], 20: [-0.8125, 0.25, 0] };
  for (const [i, values] of Object.entries(xy)) seen.xy.set(values, 2 * Number(i));
  for (const [i, values] of Object.entries(world)) seen.world.set(values, 3 * Number(i));
  seen.visibility.set([1], 0);
  seen.visibility.set([0.25], 32);
  return seen;
}

const hex = (bytes: ArrayBuffer): string =>
  [...new Uint8Array(bytes)].map((byte) => byte.toString(16).padStart(2, "0")).join("");

describe("encodeKeypoints", () => {
  it("writes the very bytes that the server's own encoder writes", () => {
    const bytes = encodeKeypoints(7, 1500, 72, somebody());
    expect(bytes.byteLength).toBe(KEYPOINTS_BYTES);
    expect(hex(bytes)).toBe(GOLDEN);
  });

  it("adds face and hands where they were seen, as the server's encoder does", () => {
    const values = new Float32Array([0.2, 1, 0, 0.4, 2, -1, 0.6, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.8]);
    const bytes = encodeKeypoints(7, 1500, 72, somebody(), { values, known: FACE | LEFT_HAND });
    expect(bytes.byteLength).toBe(LONGEST_KEYPOINTS_BYTES);
    expect(hex(bytes)).toBe(GOLDEN.slice(0, -2) + GOLDEN_EXPRESSION);
  });

  it("marks in the highest bit of the age that live look is on", () => {
    const marked = encodeKeypoints(7, 1500, 72, somebody(), null, true);
    expect(hex(marked)).toBe(GOLDEN.slice(0, 4) + "4880" + GOLDEN.slice(8));
  });

  it("moves what is out of range to the range's end", () => {
    const seen = nobody();
    seen.xy.set([90, -90], 22);
    seen.world.set([90], 33);
    const data = new DataView(encodeKeypoints(1, 0, 1e9, seen));
    expect(data.getUint16(2, true)).toBe(32767);
    expect([data.getInt16(20, true), data.getInt16(22, true)]).toEqual([32767, -32768]);
    expect([data.getUint16(24, true), data.getUint16(26, true)]).toEqual([65535, 65535]);
  });

  it("holds a person of whom nothing is told apart", () => {
    const data = new DataView(encodeKeypoints(1, 0, 0, nobody()));
    for (let at = 24; at < 32; at += 2) expect(data.getUint16(at, true)).toBe(0);
  });
});
