import { describe, expect, it } from "vitest";
import { FACE, LEFT_HAND } from "../../src/landmarks/expression";
import { EXPRESSION_BYTES, KEYPOINTS_BYTES, LANDMARK_COUNT, encodeKeypoints } from "../../src/landmarks/packet";

function nobody() {
  return {
    width: 640,
    height: 480,
    xy: new Float32Array(2 * LANDMARK_COUNT),
    world: new Float32Array(3 * LANDMARK_COUNT),
    visibility: new Float32Array(LANDMARK_COUNT),
  };
}

const hex = (bytes: ArrayBuffer): string =>
  [...new Uint8Array(bytes)].map((byte) => byte.toString(16).padStart(2, "0")).join("");

describe("encodeKeypoints", () => {
  it("writes the very bytes that the server's own encoder writes", () => {
    const seen = nobody();
    seen.xy.set([0.5, -0.25], 0);
    seen.xy.set([1, 1.5], 64);
    seen.world.set([0.125, -0.5, 1], 0);
    seen.world.set([-1, 0.25, -0.0625], 96);
    seen.visibility.set([1], 0);
    seen.visibility.set([0.2], 32);
    const bytes = encodeKeypoints(7, 1500, seen);
    expect(bytes.byteLength).toBe(KEYPOINTS_BYTES);
    expect(hex(bytes)).toBe(
      "01010000" + "07000000" + "0000000000709740" + // version 1, kind 1, flags, sequence, 1500.0
        "8002" + "e001" + // 640 x 480
        "001000f8" + "00000000".repeat(31) + "00200030" + // xy
        "000400f00020" + "000000000000".repeat(31) + "00e0000800fe" + // xyz
        "ff" + "00".repeat(31) + "33", // visibility
    );
  });

  it("adds eighteen bytes where face or hands were seen, as the server's encoder does", () => {
    const values = new Float32Array([0.2, 1, 0, 0.4, 2, -1, 0.6, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.8]);
    const plain = hex(encodeKeypoints(7, 1500, nobody()));
    const bytes = encodeKeypoints(7, 1500, nobody(), { values, known: FACE | LEFT_HAND });
    expect(bytes.byteLength).toBe(KEYPOINTS_BYTES + EXPRESSION_BYTES);
    expect(hex(bytes)).toBe(plain + "33ff0066ff0099" + "00".repeat(9) + "cc03");
  });

  it("moves what is out of range to the range's end", () => {
    const seen = nobody();
    seen.xy.set([9, -9], 0);
    seen.visibility.set([2, -1], 0);
    const data = new DataView(encodeKeypoints(1, 0, seen));
    expect([data.getInt16(20, true), data.getInt16(22, true)]).toEqual([32767, -32768]);
    expect([data.getUint8(350), data.getUint8(351)]).toEqual([255, 0]);
  });
});
