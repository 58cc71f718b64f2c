import { expect, it } from "vitest";
import { readMotion } from "../../src/motion/motionReader";
import { KIND_MOTION, MOTION_BYTES } from "../../src/motion/motionPacket";
import { decodeLook } from "../../src/recolouring/packets";
import { readTrack } from "../../src/replay/tracks";
import { readSplats } from "../../src/splats/file";
import { decodePose, posesIn } from "../../src/transport/packets";

/** Numbers from 0 to 1, the same in each run (mulberry32). */
function numbers(seed: number): () => number {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let mixed = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32;
  };
}

/** Bytes of anything, behind a head that lets them in. */
function messages(head: readonly number[], lengths: readonly number[], count = 400): ArrayBuffer[] {
  const random = numbers(7);
  return Array.from({ length: count }, (_, i) => {
    const length = random() < 0.5 ? (lengths[i % lengths.length] ?? 0) : Math.floor(500 * random());
    const bytes = Uint8Array.from({ length }, () => 256 * random());
    bytes.set(head.slice(0, length));
    return bytes.buffer;
  });
}

it("takes no motion but one that a body can make, whoever has the key of a sealed meeting", () => {
  for (const message of messages([1, KIND_MOTION, 0, 0], [MOTION_BYTES])) {
    const motion = readMotion(message);
    if (motion === null) continue;
    const told = [...motion.now.local, ...motion.now.root, ...motion.ahead, ...motion.aheadRoot, ...motion.expression];
    expect(told.every((value) => Number.isFinite(value))).toBe(true);
  }
});

it("drops what is no packet of a pose, a batch or a look", () => {
  for (let kind = 0; kind < 12; kind++) {
    for (const message of messages([1, kind], [12, 20, 27, 28, 176, 200], 100)) {
      for (const one of posesIn(message)) decodePose(one);
      decodeLook(message);
    }
  }
});

it("refuses tracks that break off and files that hold no splats, and takes no memory for what they say", () => {
  for (const message of messages([77, 78, 83, 80, 7, 0], [60, 160, 400])) {
    for (const read of [() => readTrack(message, () => null), () => readSplats(message), () => readSplats(message, 1, true)]) {
      try {
        read();
      } catch (error) {
        expect(error).toBeInstanceOf(Error);
        expect((error as Error).message).not.toContain("allocation");
      }
    }
  }
});
