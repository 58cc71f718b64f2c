import { describe, expect, it } from "vitest";
import type { Problem } from "../../src/api/problem";
import type { SolvedBody } from "../../src/motion/body";
import { MotionChannel, type Channel } from "../../src/motion/channel";
import { MOTION_BYTES } from "../../src/motion/motionPacket";
import { BODY_PACKET } from "./bodyPacket";

class FakeChannel implements Channel {
  binaryType: BinaryType = "blob";
  readyState: RTCDataChannelState = "open";
  bufferedAmount = 0;
  onmessage: Channel["onmessage"] = null;
  asked = 0;
  sent: ArrayBuffer[] = [];
  send = (data: ArrayBuffer | string): void => void (typeof data === "string" ? this.asked++ : this.sent.push(data.slice(0)));
  close = (): void => void (this.readyState = "closed");
  hear = (data: ArrayBuffer | string): void => void this.onmessage?.({ data } as MessageEvent);
}

function setUp() {
  const channels: FakeChannel[] = [];
  const problems: Problem[] = [];
  const bodies: SolvedBody[] = [];
  const open = (): Channel => (channels.push(new FakeChannel()), channels.at(-1) as FakeChannel);
  const hooks = { onBody: (body: SolvedBody) => void bodies.push(body), onRefused: (one: Problem) => void problems.push(one) };
  return { channels, problems, bodies, link: new MotionChannel(open, hooks) };
}

function told() {
  const made = setUp();
  made.link.ready(0);
  const channel = made.channels[0] as FakeChannel;
  channel.hear(BODY_PACKET);
  return { ...made, channel };
}

const packet = (): ArrayBuffer => new ArrayBuffer(MOTION_BYTES);
const header = (bytes: ArrayBuffer | undefined): DataView => new DataView(bytes as ArrayBuffer);

describe("MotionChannel", () => {
  it("asks for the body until it is told, since question and answer may be lost", () => {
    const { channels, bodies, link } = setUp();
    expect([0, 100, 260, 300, 520].map((nowMs) => link.ready(nowMs))).toEqual([false, false, false, false, false]);
    const [channel] = channels as [FakeChannel];
    expect([channel.asked, channel.binaryType]).toEqual([3, "arraybuffer"]);
    link.send(packet(), 1);
    expect(channel.sent).toEqual([]);
    channel.hear(new ArrayBuffer(3));
    expect(bodies).toEqual([]);
    channel.hear(BODY_PACKET);
    channel.hear(BODY_PACKET);
    expect(bodies).toHaveLength(1);
    expect(bodies[0]?.yaw).toBeCloseTo(0.25);
    expect(link.ready(900)).toBe(true);
    expect(channel.asked).toBe(3);
  });

  it("numbers packets, and tells how old their pictures are", () => {
    const { link, channel } = told();
    link.send(packet(), performance.timeOrigin + performance.now() - 50);
    link.send(packet(), performance.timeOrigin + performance.now());
    expect(channel.sent.map((one) => header(one).getUint32(4, true))).toEqual([1, 2]);
    expect(header(channel.sent[0]).getUint16(2, true)).toBeGreaterThanOrEqual(50);
  });

  it("sends nothing that would have to wait", () => {
    const { link, channel } = told();
    channel.bufferedAmount = 5 * MOTION_BYTES;
    link.send(packet(), 2);
    [channel.bufferedAmount, channel.readyState] = [0, "connecting"];
    link.send(packet(), 3);
    expect([channel.sent.length, link.ready(1)]).toEqual([0, false]);
  });

  it("opens anew after the connection was cut, asks again, and goes on counting", () => {
    const { channels, bodies, link, channel } = told();
    link.send(packet(), 1);
    channel.readyState = "closed";
    expect(link.ready(10)).toBe(false);
    const next = channels[1] as FakeChannel;
    next.hear(BODY_PACKET);
    link.send(packet(), 2);
    expect([channels.length, bodies.length, next.asked]).toEqual([2, 2, 1]);
    expect(header(next.sent[0]).getUint32(4, true)).toBe(2);
  });

  it("tells at once that live look is off", () => {
    const { link, channel } = told();
    link.endLook();
    expect(channel.sent).toEqual([]);
    const marked = packet();
    header(marked).setUint16(2, 0x8000, true);
    link.send(marked, performance.timeOrigin + performance.now());
    link.endLook();
    expect(channel.sent.map((one) => header(one).getUint16(2, true) >= 0x8000)).toEqual([true, false]);
  });

  it("ends where the server refuses, in the server's words", () => {
    const { channels, problems, link, channel } = told();
    channel.hear(JSON.stringify({ status: 409, title: "Driven elsewhere", detail: "got a newer one" }));
    expect(problems.map(({ status, detail }) => [status, detail])).toEqual([[409, "Got a newer one."]]);
    channel.readyState = "closed";
    expect(link.ready(1000)).toBe(false);
    expect(channels).toHaveLength(1);
  });
});
