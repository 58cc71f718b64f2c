import { beforeEach, describe, expect, it } from "vitest";
import type { Channel } from "../../src/motion/channel";
import { MeetingKey } from "../../src/sealing/meetingKey";
import { SealedMotions } from "../../src/sealing/sealedMotions";
import { Sealing } from "../../src/sealing/sealing";
import { decodePose, performerCheck } from "../../src/transport/packets";
import { FRONT } from "../viewpoint/front";
import { CASES, KEY, bytesOf } from "./cases";

const standing = (id: string, x: number) => ({ id, name: id.toUpperCase(), position: [x, 0, 0] as [number, number, number], yaw_rad: 0.4, viewpoint: { ...FRONT, azimuth_rad: 0.4 } });
const ADA = standing("ada", 0);
const BO = standing("bo", 1);
const PELVIS = [0, 0.9, 0];
const PACKETS = CASES.followed.packets;
const TIMES = PACKETS.map(({ packet }) => new DataView(bytesOf(packet)).getFloat64(8, true));

let sent: ArrayBuffer[];
let people: ReturnType<typeof standing>[];
let wallMs: number;
let unreadable: (readonly string[])[];

beforeEach(() => {
  sent = [];
  unreadable = [];
  people = [ADA, BO];
  wallMs = TIMES[0]!;
});

const channel = (): Channel => ({ binaryType: "arraybuffer", readyState: "open", bufferedAmount: 0, onmessage: null, send: (data) => void sent.push(data as ArrayBuffer), close: () => undefined });

/** What a page with `key` sends of the motion of `id`. */
async function sealedBy(key: MeetingKey, id: string, motions: string[]): Promise<ArrayBuffer[]> {
  sent = [];
  const sealing = new Sealing({ id: CASES.meeting, performers: [] }, key).channel(channel(), id)!;
  for (const motion of motions) sealing.send(bytesOf(motion));
  while (sent.length < motions.length) await new Promise((done) => setTimeout(done));
  return sent;
}

/** As the server passes packets on. */
function passedOn(packets: [number, ArrayBuffer][]): ArrayBuffer {
  const records = packets.flatMap(([index, packet]) => {
    const check = performerCheck(people[index]!.id);
    return [index, people.length, check & 255, check >> 8, ...new Uint8Array(packet)];
  });
  return Uint8Array.of(1, 11, ...records).buffer;
}

function viewer(key: MeetingKey | null = KEY): SealedMotions {
  const motions = new SealedMotions(key, CASES.meeting, () => people, () => wallMs);
  motions.onUnreadable = (names) => unreadable.push(names);
  return motions;
}

const posesAt = (motions: SealedMotions, nowMs: number) => motions.due(nowMs, people.map(() => PELVIS)).map((bytes) => decodePose(bytes)!);
const same = (a: ArrayLike<number>, b: ArrayLike<number>): boolean => Array.from(a).every((value, i) => Math.abs(value - b[i]!) < 1e-6);

describe("SealedMotions", () => {
  it("moves whose packets open, at their place, and has everybody else stand", async () => {
    const motions = viewer();
    const [rest] = posesAt(motions, 0);
    const packets = await sealedBy(KEY, "bo", [PACKETS[0]!.packet]);
    await motions.accept(passedOn([[1, packets[0]!]]), 1000);
    const [ada, bo] = posesAt(motions, 1000);
    expect([ada, bo].map((pose) => [pose!.index, pose!.count, pose!.check])).toEqual([[0, 2, performerCheck("ada")], [1, 2, performerCheck("bo")]]);
    expect(same(ada!.rotations, rest!.rotations)).toBe(true);
    expect(same(bo!.rotations, rest!.rotations)).toBe(false);
    expect(Math.hypot(bo!.pelvis[0] - 1, bo!.pelvis[1] - 0.9, bo!.pelvis[2])).toBeLessThan(1);
    expect(ada!.pelvis[1]).toBeCloseTo(0.9);
    // the quaternion of who stands faces the front: a turn about +y by what their place says
    expect([ada!.rotations[0], ada!.rotations[2]]).toEqual([expect.closeTo(Math.cos(0.2), 3), expect.closeTo(Math.sin(0.2), 3)]);
  });

  it("numbers poses, 30 a second, once it is known how tall everybody is", () => {
    const motions = viewer();
    expect(motions.due(0, [])).toEqual([]);
    const sequences = Array.from({ length: 60 }, (_, frame) => posesAt(motions, (1000 * frame) / 60)[0]?.sequence).filter((one) => one !== undefined);
    expect(sequences.length).toBeGreaterThanOrEqual(29);
    expect(sequences.length).toBeLessThanOrEqual(31);
    expect(sequences).toEqual(sequences.map((_, i) => i + 1));
  });

  it("has nobody move by another key, and says whose motion does not open until it does", async () => {
    const motions = viewer();
    const before = posesAt(motions, 0);
    await motions.accept(passedOn([[0, (await sealedBy(MeetingKey.random(), "ada", [PACKETS[0]!.packet]))[0]!]]), 100);
    expect(same(posesAt(motions, 200)[0]!.rotations, before[0]!.rotations)).toBe(true);
    expect(unreadable).toEqual([["ADA"]]);
    await motions.accept(passedOn([[0, (await sealedBy(KEY, "ada", [PACKETS[0]!.packet]))[0]!]]), 300);
    expect(same(posesAt(motions, 400)[0]!.rotations, before[0]!.rotations)).toBe(false);
    expect(unreadable).toEqual([["ADA"], []]);
  });

  it("has nobody move without a key", async () => {
    const motions = viewer(null);
    const before = posesAt(motions, 0);
    await motions.accept(passedOn([[0, (await sealedBy(KEY, "ada", [PACKETS[0]!.packet]))[0]!]]), 100);
    expect(same(posesAt(motions, 200)[0]!.rotations, before[0]!.rotations)).toBe(true);
    expect(new Sealing({ id: CASES.meeting, performers: [] }, null).channel(channel(), "ada")).toBeNull();
  });

  it("does not move one person by the packets of another", async () => {
    const motions = viewer();
    const before = posesAt(motions, 0);
    await motions.accept(passedOn([[1, (await sealedBy(KEY, "ada", [PACKETS[0]!.packet]))[0]!]]), 100);
    expect(same(posesAt(motions, 200)[1]!.rotations, before[1]!.rotations)).toBe(true);
    expect(unreadable).toEqual([["BO"]]);
  });

  it("ignores what is meant for somebody whom the roster does not name", async () => {
    const motions = viewer();
    const message = passedOn([[0, (await sealedBy(KEY, "ada", [PACKETS[0]!.packet]))[0]!]]);
    people = [BO];
    await motions.accept(message, 100);
    posesAt(motions, 200);
    expect(unreadable).toEqual([]);
  });

  it("shows no sealed motion of earlier as if it were now", async () => {
    const motions = viewer();
    const [old] = await sealedBy(KEY, "ada", [PACKETS[0]!.packet]);
    wallMs = TIMES[0]! + 10 * 60_000;
    await motions.accept(passedOn([[0, old!]]), 100);
    posesAt(motions, 200);
    expect(unreadable).toEqual([["ADA"]]);
  });

  it("shows no motion of nobody, though it was sealed well: it jumps, or holds no numbers", async () => {
    const motions = viewer();
    const [first, second] = [PACKETS[0]!, PACKETS[1]!].map(({ packet }) => new DataView(bytesOf(packet)));
    const odd = new DataView(second!.buffer.slice(0));
    odd.setFloat64(8, first!.getFloat64(8, true) + 1, true);
    odd.setFloat32(16, first!.getFloat32(16, true) + 1, true);
    const nothing = new DataView(second!.buffer.slice(0));
    nothing.setFloat32(16, NaN, true);
    const hex = (data: DataView): string => [...new Uint8Array(data.buffer as ArrayBuffer)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
    const packets = await sealedBy(KEY, "ada", [hex(first!), hex(odd), hex(nothing)]);
    await motions.accept(passedOn([[0, packets[0]!]]), 0);
    const before = posesAt(motions, 0)[0]!;
    for (const packet of packets.slice(1)) await motions.accept(passedOn([[0, packet]]), 1);
    expect(same(posesAt(motions, 34)[0]!.pelvis, before.pelvis) || Math.abs(posesAt(motions, 68)[0]!.pelvis[0] - before.pelvis[0]) < 0.1).toBe(true);
    expect(unreadable).toEqual([["ADA"]]);
  });
});
