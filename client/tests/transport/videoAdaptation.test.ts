import { describe, expect, it } from "vitest";
import { VideoAdaptation, type SecondStats, type AdaptationStep } from "../../src/transport/videoAdaptation";

/** A line on which the server sends so many packets of pictures a second; the rest is lost. */
function line() {
  const flow = new VideoAdaptation();
  const counted = { received: 0, lost: 0 };
  const second = (fps: number, sent: number, came: number, more: Partial<SecondStats> = {}): AdaptationStep => {
    counted.received += came;
    counted.lost += sent - came;
    return flow.observe({ fps, ...counted, live: true, adapts: true, highest: 4, coarse: false, patienceS: 4, ...more });
  };
  const good = (): AdaptationStep => (flow.audioOnly ? second(0, 0, 0) : second(30, 60, 60));
  const starved = (): AdaptationStep => (flow.audioOnly ? second(0, 0, 0) : second(1, 60, 12));
  const times = (count: number, act: () => AdaptationStep): AdaptationStep[] => Array.from({ length: count }, act).filter((step) => step !== "keep");
  return { flow, counted, second, good, starved, times };
}

describe("VideoAdaptation", () => {
  it("goes down to audio only on a starved line, and back up to large pictures once it is good", () => {
    const { flow, good, starved, times } = line();
    times(3, starved);
    expect(flow.side).toBe(256);
    expect(times(5, starved)).toEqual(["request"]);
    expect(flow.audioOnly).toBe(true);
    expect(times(30, good).every((step) => step === "request")).toBe(true);
    expect(flow.audioOnly).toBe(false);
    times(60, good);
    expect(flow.side).toBe(1024);
  });

  it("asks for no larger pictures of what is drawn coarsely, and for smaller ones all the same", () => {
    const { flow, second, times } = line();
    times(60, () => second(30, 60, 60, { coarse: true }));
    expect(flow.side).toBe(512);
    times(4, () => second(10, 60, 60, { coarse: true }));
    expect(flow.side).toBe(384);
    times(60, () => second(30, 60, 60));
    expect(flow.side).toBe(1024);
  });

  it("never renews a connection that loses packets, however long no picture comes", () => {
    const { flow, second, times } = line();
    const nothing = (): AdaptationStep => (flow.audioOnly ? second(0, 0, 0) : second(0, 60, 2));
    expect(times(8, nothing)).toEqual(["request", "request"]);
    expect(flow.audioOnly).toBe(true);
  });

  it("does not blame the line for a server that sends few pictures", () => {
    const { flow, second, times } = line();
    times(60, () => second(2, 8, 8));
    expect([flow.audioOnly, flow.side]).toEqual([false, 256]);
    times(60, () => second(2, 100, 99)); // one in a hundred is lost anywhere
    expect(flow.audioOnly).toBe(false);
  });

  it("renews a connection that brings nothing, and goes on with audio only where that does not help", () => {
    const { flow, counted, second, times } = line();
    times(10, () => second(30, 60, 60));
    const nothing = (patienceS: number, live: boolean) => (): AdaptationStep => second(0, 0, 0, { patienceS, live });
    expect(times(4, nothing(4, true)).at(-1)).toBe("reconnect");
    counted.received = 0;
    flow.resetPatience();
    expect(times(20, nothing(20, false))).toEqual(["request"]);
    expect(flow.audioOnly).toBe(true);
    // nothing came since: to try again takes a connection of its own
    expect(times(14, nothing(4, true))).toEqual(["reconnect"]);
    expect(flow.audioOnly).toBe(false);
  });

  it("tells whoever joins on a starved line of audio only once patience is over", () => {
    const { flow, second, times } = line();
    expect(times(20, () => second(0, 60, 3, { live: false, patienceS: 20 }))).toEqual(["request"]);
    expect(flow.audioOnly).toBe(true);
  });

  it("only renews where nothing may be asked for", () => {
    const { flow, second, times } = line();
    expect(times(12, () => second(0, 60, 3, { adapts: false }))).toEqual(["reconnect", "reconnect", "reconnect"]);
    expect(flow.audioOnly).toBe(false);
  });

  it("stays with audio only while pictures come another way", () => {
    const { flow, starved, times } = line();
    times(8, starved);
    flow.restart();
    expect(flow.audioOnly).toBe(true);
  });
});
