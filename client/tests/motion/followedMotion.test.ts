import { describe, expect, it } from "vitest";
import { followed } from "../../../tests/services/live/sealed.json";
import { LEFT, RIGHT } from "../../src/motion/body";
import { FollowedMotion } from "../../src/motion/followedMotion";
import { isPlausible, readMotion } from "../../src/motion/motionReader";
import { rotationsBy } from "../../src/motion/rotations";
import { bytesOf } from "../sealing/cases";

const LEGS = [LEFT, RIGHT].flatMap(({ hip, knee, ankle }): number[] => [hip, knee, ankle]);
const off = (a: ArrayLike<number>, b: ArrayLike<number>): number => Math.max(...Array.from(b, (value, i) => Math.abs(value - a[i]!)));

describe("FollowedMotion", () => {
  it("shows at each moment what the server would show, and comes to rest as it does but for the legs", () => {
    const motion = new FollowedMotion(followed.yaw_rad);
    let last: ReturnType<typeof readMotion> = null;
    let [exact, easing] = [0, 0];
    for (const { packet, arrived_s, poses } of followed.packets) {
      const read = readMotion(bytesOf(packet))!;
      expect(isPlausible(read, last)).toBe(true);
      motion.follow(read, arrived_s);
      last = read;
      for (const wanted of poses) {
        const { local, root, expression } = motion.poseAt(wanted.now_s);
        const truth = rotationsBy(Float64Array.from(wanted.angles));
        const upper = (rotations: Float64Array): Float64Array => rotations.filter((_, i) => !LEGS.includes(Math.floor(i / 9)));
        expect(off(upper(local), upper(truth))).toBeLessThan(1e-5);
        expect(off(local, truth)).toBeLessThan(0.1);
        expect(off(root, wanted.root)).toBeLessThan(1e-3);
        expect(off(expression, wanted.expression)).toBeLessThan(1e-4);
        if (off(local, truth) < 1e-5) exact += 1;
        else easing += 1;
      }
    }
    expect([exact > 15, easing > 5]).toEqual([true, true]);
  });

  it("stands at rest before any motion came", () => {
    const { local, root } = new FollowedMotion(0).poseAt(0);
    expect([...local.slice(0, 9)]).toEqual([1, 0, 0, 0, 1, 0, 0, 0, 1]);
    expect([...root]).toEqual([0, 0, 0]);
  });
});

describe("readMotion", () => {
  const good = bytesOf(followed.packets[0]!.packet);
  const changed = (change: (data: DataView) => void): ArrayBuffer => {
    const other = good.slice(0);
    change(new DataView(other));
    return other;
  };

  it.each<[string, (data: DataView) => void]>([
    ["of another version", (data) => data.setUint8(0, 2)],
    ["of another kind", (data) => data.setUint8(1, 2)],
    ["with live look", (data) => data.setUint16(2, 0x8000, true)],
    ["of no time", (data) => data.setFloat64(8, NaN, true)],
    ["of a time before any", (data) => data.setFloat64(8, -1, true)],
    ["of a time after all", (data) => data.setFloat64(8, 2 ** 54, true)],
    ["nowhere", (data) => data.setFloat32(16, NaN, true)],
    ["too far away", (data) => data.setFloat32(20, 3.1, true)],
    ["that goes too far", (data) => data.setFloat32(28, -Infinity, true)],
    ["that turns too far", (data) => data.setFloat32(40, 3.2, true)],
    ["that turns backwards", (data) => data.setFloat32(40, -1, true)],
    ["with what is no rotation", (data) => [44, 46, 48].forEach((at) => data.setUint16(at, 0xffff, true))],
  ])("refuses a packet %s", (_, change) => {
    expect(readMotion(good)).not.toBeNull();
    expect(readMotion(changed(change))).toBeNull();
  });

  it("refuses packets of other lengths", () => {
    for (const length of [0, 16, 277]) expect(readMotion(good.slice(0, length))).toBeNull();
  });

  it("never gives anything but finite numbers within a body's reach, whatever comes", () => {
    let seed = 7;
    const random = (): number => (seed = (seed * 1103515245 + 12345) % 2 ** 31) >> 8;
    let read = 0;
    for (let i = 0; i < 3000; i++) {
      const packet = changed((data) => {
        for (let k = 0; k < 3; k++) data.setUint8(2 + (random() % 276), random() & 255);
      });
      const motion = readMotion(packet);
      if (!motion) continue;
      read += 1;
      for (const values of [motion.now.local, motion.now.root, motion.ahead, motion.aheadRoot, motion.expression]) {
        expect(values.every((value) => Math.abs(value) <= 3.2)).toBe(true);
      }
    }
    expect(read).toBeGreaterThan(100);
  });

  it("finds nobody plausible who is faster than people are, or does not come later", () => {
    const [a, b] = [readMotion(good)!, readMotion(changed((data) => data.setFloat64(8, data.getFloat64(8, true) + 10, true)))!];
    expect([isPlausible(b, a), isPlausible(a, b), isPlausible(a, a)]).toEqual([true, false, false]);
    b.now.root[0]! += 0.25;
    expect(isPlausible(b, a)).toBe(false);
  });
});
