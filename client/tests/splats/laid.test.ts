import { describe, expect, it } from "vitest";
import { PICTURE_PX } from "../../src/look/cutOut";
import {
  CHEST,
  LAID_FULL_RAD,
  LAID_GONE_RAD,
  LARGEST_DETAIL,
  layingOf,
  packDetail,
  packPlaces,
  PLACE_BITS,
  PLACE_STEPS,
  SHARE_STEPS,
  strengthAt,
} from "../../src/splats/laid";
import { placeTakenToOrigin, transformed, TRANSFORM } from "../../src/splats/skeleton";

describe("packed detail", () => {
  it("leaves one as it is, and takes factors from nil to four", () => {
    const [packed = 0] = packDetail(Float32Array.of(1, 0.25, 4));
    const factors = [0, 10, 20].map((shift) => (LARGEST_DETAIL * ((packed >>> shift) & 1023)) / 1023);
    expect(factors[0]).toBeCloseTo(1, 12);
    expect(factors[1]).toBeCloseTo(0.25, 2);
    expect(factors[2]).toBeCloseTo(4, 12);
    expect(packDetail(Float32Array.of(0, 0, 9))).toEqual(Uint32Array.of(1023 << 20));
  });
});

describe("packed places", () => {
  const unpacked = (packed: number): number[] => [
    ((packed & PLACE_STEPS) * PICTURE_PX) / PLACE_STEPS,
    (((packed >>> PLACE_BITS) & PLACE_STEPS) * PICTURE_PX) / PLACE_STEPS,
    (packed >>> (2 * PLACE_BITS)) / SHARE_STEPS,
  ];

  it("are right to a twentieth of a pixel", () => {
    const places = [0, 0, 1, 287.9, 12.34, 0.5, 100.02, 200.07, 0.02, 288, 288, 1];
    packPlaces(Float32Array.from(places)).forEach((packed, i) => {
      const [x = 0, y = 0, share = 0] = unpacked(packed);
      expect(Math.abs(x - (places[3 * i] ?? 0))).toBeLessThan(0.05);
      expect(Math.abs(y - (places[3 * i + 1] ?? 0))).toBeLessThan(0.05);
      expect(share).toBeCloseTo(places[3 * i + 2] ?? 0, 2);
    });
  });

  it("are none beside the picture, and none of who is not seen", () => {
    expect([...packPlaces(Float32Array.of(-0.1, 5, 1, 5, 384.1, 1, 5, 5, 0))]).toEqual([0, 0, 0]);
  });
});

/** Rest joints and transforms, of which the chest's turns by `yawRad` about +y and then goes to `to`. */
function chestAt(yawRad: number, to: readonly [number, number, number], rest: readonly [number, number, number] = [0, 1.3, 0]) {
  const before = 5;
  const restJoints = new Float32Array(3 * (CHEST + 1));
  restJoints.set(rest, 3 * CHEST);
  const transforms = new Float32Array(before + TRANSFORM * (CHEST + 1));
  const [c, s] = [Math.cos(yawRad), Math.sin(yawRad)];
  transforms.set([c, 0, s, to[0], 0, 1, 0, to[1], -s, 0, c, to[2]], before + TRANSFORM * CHEST);
  return { restJoints, transforms, at: before };
}

describe("layingOf", () => {
  const picture = { webcam: [0, 1.3, 1.2], focalPx: 300 } as const;
  const eyeAt = (angleRad: number, awayM: number, focalPx = 500) => ({
    eye: [awayM * Math.sin(angleRad), 1.3, awayM * Math.cos(angleRad)] as const,
    focalPx: [focalPx, 7] as const,
  });
  const laying = (eye: ReturnType<typeof eyeAt>, chest = chestAt(0, [0, 0, 0])) =>
    layingOf(picture, chest.restJoints, chest.transforms, chest.at, eye);

  it("lays a picture on in full at the webcam's place, pixel on pixel of as long a lens", () => {
    expect(laying(eyeAt(0, 1.2, 300))).toEqual({ strength: 1, scale: expect.closeTo(1, 6) as number });
  });

  it("scales by distance and lens", () => {
    expect(laying(eyeAt(0, 3.6, 500)).scale).toBeCloseTo((300 / 1.2) / (500 / 3.6), 5);
  });

  it("fades beside the webcam", () => {
    const middle = (LAID_FULL_RAD + LAID_GONE_RAD) / 2;
    expect(laying(eyeAt(0.99 * LAID_FULL_RAD, 2)).strength).toBe(1);
    expect(laying(eyeAt(middle, 2)).strength).toBeCloseTo(0.5, 4);
    expect(laying(eyeAt(1.01 * LAID_GONE_RAD, 2)).strength).toBe(0);
    expect(laying(eyeAt(Math.PI, 2)).strength).toBe(0);
  });

  it("goes with the chest: who turns away takes the webcam along", () => {
    const turned = chestAt(0.7, [0, 0, 0]);
    expect(laying(eyeAt(0.7, 2), turned).strength).toBe(1);
    expect(laying(eyeAt(0, 2), turned).strength).toBe(0);
    const moved = chestAt(0, [3, 0, 0]);
    expect(laying({ ...eyeAt(0, 2), eye: [3, 1.3, 2] }, moved).strength).toBe(1);
  });

  it("falls smoothly, as 3 t^2 - 2 t^3", () => {
    expect(strengthAt(LAID_FULL_RAD + 0.25 * (LAID_GONE_RAD - LAID_FULL_RAD))).toBeCloseTo(1 - (3 / 16 - 2 / 64), 6);
  });
});

describe("placeTakenToOrigin", () => {
  it("is where the joint's transform begins that ends at the origin", () => {
    const { transforms, at } = chestAt(0.4, [0.3, -0.2, -1.1]);
    const place = placeTakenToOrigin(transforms, at + TRANSFORM * CHEST);
    transformed(transforms, at + TRANSFORM * CHEST, place).forEach((value) => expect(value).toBeCloseTo(0, 6));
    expect(place[1]).toBeCloseTo(0.2, 6);
  });
});
