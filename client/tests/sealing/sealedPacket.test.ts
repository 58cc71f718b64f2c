import { describe, expect, it } from "vitest";
import { MeetingKey } from "../../src/sealing/meetingKey";
import { MotionOpener, MotionSealer, SEALED_BYTES } from "../../src/sealing/sealedPacket";
import { CASES, KEY, bytesOf, flipped, hexOf } from "./cases";

const { meeting, performer, packets, salt } = CASES;
const MOTION = bytesOf(packets[0]!.motion);
const opener = (key = KEY, meetingId = meeting, performerId = performer): MotionOpener => new MotionOpener(key, meetingId, performerId);
const sealer = (): MotionSealer => new MotionSealer(KEY, meeting, performer);
const kindOf = async (from: MotionOpener, packet: ArrayBuffer): Promise<string> => (await from.open(packet)).kind;

describe("MotionSealer", () => {
  it("makes the very bytes that another library makes", async () => {
    const same = new MotionSealer(KEY, meeting, performer, new Uint8Array(bytesOf(salt)));
    for (const { motion, sealed, counter } of packets.filter(({ counter }) => counter < 3)) {
      expect([counter, hexOf(await same.seal(bytesOf(motion)))]).toEqual([counter, sealed]);
    }
  });

  it("never uses a nonce twice under one key: connections differ by their salts, packets by their counters", async () => {
    const [a, b] = [sealer(), sealer()];
    const heads = await Promise.all([a, b, a, b, a].map(async (one) => hexOf((await one.seal(MOTION)).slice(0, 24))));
    expect(new Set(heads).size).toBe(5);
  });

  it("shows nothing of the motion, not even that it is the same", async () => {
    const one = sealer();
    const [first, second] = [new Uint8Array(await one.seal(MOTION)), new Uint8Array(await one.seal(MOTION))];
    const alike = first.subarray(24).filter((byte, i) => byte === second[24 + i]).length;
    expect(alike).toBeLessThan(16);
    expect([first.length, second.length]).toEqual([SEALED_BYTES, SEALED_BYTES]);
  });

  it("takes no packet that brings live look", async () => {
    await expect(sealer().seal(new ArrayBuffer(360))).rejects.toThrow("278 bytes");
  });
});

describe("MotionOpener", () => {
  it("opens what another library sealed, up to the last counter", async () => {
    const one = opener();
    for (const [i, { motion, sealed }] of packets.entries()) {
      expect(await one.open(bytesOf(sealed))).toEqual({ kind: "opened", motion: bytesOf(motion), first: i === 0 });
    }
  });

  it("refuses a packet of which any bit was changed, and goes on", async () => {
    const sealed = bytesOf(packets[0]!.sealed);
    const one = opener();
    const kinds = new Set<string>();
    // each bit of the head, and some of every byte behind it
    for (let bit = 0; bit < 8 * SEALED_BYTES; bit += bit < 192 ? 1 : 5) kinds.add(await kindOf(one, flipped(sealed, bit)));
    expect([...kinds]).toEqual(["refused"]);
    expect(await kindOf(one, sealed)).toBe("opened");
  });

  it("refuses what is too short or too long", async () => {
    const sealed = bytesOf(packets[0]!.sealed);
    for (const length of [0, 1, 23, 24, 40, SEALED_BYTES - 1]) expect(await kindOf(opener(), sealed.slice(0, length))).toBe("refused");
    expect(await kindOf(opener(), new Uint8Array([...new Uint8Array(sealed), 0]).buffer)).toBe("refused");
  });

  it("refuses one performer's packet as another's, or of another meeting, or by another key", async () => {
    const sealed = bytesOf(packets[0]!.sealed);
    for (const one of [opener(KEY, meeting, "another"), opener(KEY, "another"), opener(MeetingKey.random())]) {
      expect(await kindOf(one, sealed)).toBe("refused");
    }
  });

  it("opens each packet once, and none before one that it has opened", async () => {
    const [one, sent] = [opener(), sealer()];
    const all: ArrayBuffer[] = [];
    for (let i = 0; i < 8; i++) all.push(await sent.seal(MOTION));
    const kinds: string[] = [];
    for (const i of [0, 0, 3, 2, 1, 3, 7, 0, 6, 7]) kinds.push(await kindOf(one, all[i]!));
    expect(kinds).toEqual(["opened", "old", "opened", "old", "old", "old", "opened", "old", "old", "old"]);
  });

  it("opens one of two that come at once", async () => {
    const [one, packet] = [opener(), await sealer().seal(MOTION)];
    const kinds = (await Promise.all([one.open(packet), one.open(packet)])).map(({ kind }) => kind);
    expect(kinds.sort()).toEqual(["old", "opened"]);
  });

  it("follows a connection that was made anew, and none that it has replaced", async () => {
    const [one, before, after] = [opener(), sealer(), sealer()];
    const late = [await before.seal(MOTION), await before.seal(MOTION)] as const;
    expect(await one.open(late[0])).toMatchObject({ kind: "opened", first: true });
    expect(await one.open(await after.seal(MOTION))).toMatchObject({ kind: "opened", first: true });
    expect(await kindOf(one, late[1])).toBe("old");
    expect(await one.open(await after.seal(MOTION))).toMatchObject({ kind: "opened", first: false });
  });
});
