// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Api } from "../../src/api/api";
import type { Meeting, Performer, Seat } from "../../src/api/types";
import { Sealing } from "../../src/sealing/sealing";
import { LiveView } from "../../src/drawing/live";
import type { LiveState } from "../../src/drawing/liveState";
import { fakeFetch, json, tokenStore, type Call } from "../fakes";
import { FRONT, performer } from "../viewpoint/front";

const ADA = performer("ada", { name: "Ada", model_id: "m1", position: [1, 0, 2] });
const BO: Performer = { ...ADA, id: "bo", name: "Bo", position: [-1, 0, 2] };
const SEAT = { token: "seat", whep_url: "/whep/m", ice_servers: [], ready: true, performers: [ADA], viewpoint: FRONT } as unknown as Seat;

class FakeChannel extends EventTarget {
  readyState = "open";
  bufferedAmount = 0;
  binaryType = "";
  sent: DataView[] = [];
  send(packet: ArrayBuffer): void {
    this.sent.push(new DataView(packet));
  }
}

/** A connection that is up as soon as the server has answered. */
class FakePeer extends EventTarget {
  static made: FakePeer[] = [];
  connectionState = "new";
  iceGatheringState = "complete";
  localDescription = { sdp: "offer" };
  channels = new Map<string, FakeChannel>();
  stats = new Map<string, object>();
  closed = false;
  constructor() {
    super();
    FakePeer.made.push(this);
  }
  createDataChannel(label: string): FakeChannel {
    const channel = new FakeChannel();
    this.channels.set(label, channel);
    return channel;
  }
  addTransceiver = (): object => ({
    receiver: {},
    sender: { getParameters: () => ({}), setParameters: async () => undefined, replaceTrack: async () => undefined },
  });
  createOffer = async (): Promise<object> => ({});
  setLocalDescription = async (): Promise<void> => undefined;
  async setRemoteDescription(): Promise<void> {
    this.connectionState = "connected";
    this.dispatchEvent(new Event("connectionstatechange"));
  }
  getStats = async (): Promise<Map<string, object>> => this.stats;
  close(): void {
    this.closed = true;
  }
}

let videoFrame: () => void = () => undefined;

function setUp(answer: (call: Call) => Response = () => new Response("answer", { status: 201, headers: { Location: "/whep/m/1" } }), seat: Partial<Seat> = {}, sealing: Sealing | null = null) {
  const roster = { performers: [ADA, BO], viewpoint: FRONT, environment: "studio" };
  const { request, calls } = fakeFetch((call) => {
    if (call.method === "DELETE") return new Response();
    if (call.path === "/v1/meetings/m") return json(roster);
    return call.path === "/v1/meetings/m/environment" ? json({ name: "studio", picture_url: null, light: null }) : answer(call);
  });
  vi.stubGlobal("fetch", request);
  const meeting = { id: "m", name: "Monday", environment: "studio", performers: [ADA], viewpoint: FRONT } as unknown as Meeting;
  const seats: boolean[] = [];
  const live = new LiveView(new Api(tokenStore("guest"), request), meeting, {
    seat: async (stale) => (seats.push(stale), { ...SEAT, ...seat }),
    address: async () => "https://one.example/whep/m",
    inertia: false,
    pinned: null,
    stamped: false,
    sealing,
  });
  Object.defineProperties(live.video, {
    clientWidth: { value: 800 },
    clientHeight: { value: 600 },
    videoWidth: { value: 512 },
    videoHeight: { value: 384 },
  });
  const states: LiveState[] = [];
  live.onState = (state) => states.push(state);
  const kinds = (): string[] => states.map(({ kind }) => kind);
  /** So many seconds go by, with so many frames of video in each. */
  const seconds = async (count: number, fps = 0): Promise<void> => {
    for (let second = 0; second < count; second++) {
      for (let frame = 0; frame < fps; frame++) {
        videoFrame();
        await vi.advanceTimersByTimeAsync(1000 / fps);
      }
      if (fps === 0) await vi.advanceTimersByTimeAsync(1000);
    }
  };
  const sent = (): DataView[] => FakePeer.made.at(-1)?.channels.get("view")?.sent ?? [];
  const flags = (): number => sent().at(-1)?.getUint16(2, true) ?? -1;
  live.start();
  return { live, states, kinds, seconds, sent, flags, calls, seats, meeting, roster };
}

beforeEach(() => {
  vi.useFakeTimers();
  vi.spyOn(Math, "random").mockReturnValue(0);
  FakePeer.made = [];
  vi.stubGlobal("RTCPeerConnection", FakePeer);
  vi.stubGlobal("Worker", class extends EventTarget {
    postMessage = (): void => undefined;
    terminate = (): void => undefined;
  });
  const video = HTMLVideoElement.prototype;
  video.requestVideoFrameCallback = (callback) => {
    videoFrame = () => callback(0, {} as VideoFrameCallbackMetadata);
    return 1;
  };
  video.cancelVideoFrameCallback = () => (videoFrame = () => undefined);
  video.play = async () => undefined;
});
afterEach(() => {
  vi.useRealTimers();
  vi.restoreAllMocks();
  vi.unstubAllGlobals();
});

describe("the state of a live view", () => {
  it("is live with the first frame, not with the connection", async () => {
    const { live, kinds, seconds } = setUp();
    await seconds(1);
    expect(kinds()).toEqual(["connecting", "preparing"]);
    videoFrame();
    expect(kinds().at(-1)).toBe("live");
    live.close();
  });

  it("waits for no picture of the server in a sealed meeting, and asks for none", async () => {
    const { live, kinds, seconds, flags } = setUp(undefined, {}, new Sealing({ id: "m", performers: [] }, null));
    await seconds(60);
    expect(kinds()).toEqual(["connecting", "live"]);
    expect(FakePeer.made).toHaveLength(1);
    expect([...FakePeer.made[0]!.channels.keys()]).toEqual(["view", "pose"]);
    // neither stalled nor sound alone
    expect(flags() & 12).toBe(0);
    // and nothing that moves us leaves without a key
    expect(live.openMotionChannel("a")).toBeNull();
    live.close();
  });

  it("tells that a server on its first start takes longer", async () => {
    const { live, states, seconds } = setUp(undefined, { ready: false });
    await seconds(60);
    expect(states.at(-1)).toEqual({ kind: "preparing", firstStart: true });
    expect(FakePeer.made).toHaveLength(1);
    live.close();
  });

  it("makes a new connection where no frame comes for four seconds", async () => {
    const { live, kinds, seconds } = setUp();
    await seconds(1);
    await seconds(3, 30);
    await seconds(3);
    expect(FakePeer.made).toHaveLength(1);
    await seconds(3);
    expect(FakePeer.made[0]?.closed).toBe(true);
    expect(FakePeer.made).toHaveLength(2);
    expect(kinds()).toContain("reconnecting");
    await seconds(1, 30);
    expect(kinds().at(-1)).toBe("live");
    live.close();
  });

  it("leaves the connection of a hidden page alone", async () => {
    const { live, seconds } = setUp();
    await seconds(2, 30);
    vi.spyOn(document, "hidden", "get").mockReturnValue(true);
    await seconds(60);
    expect(FakePeer.made).toHaveLength(1);
    live.close();
  });

  it("falls to audio only where the connection loses nearly everything, and comes back with frames", async () => {
    const { live, kinds, seconds, flags } = setUp();
    await seconds(2, 30);
    const { stats } = FakePeer.made[0] as FakePeer;
    let [packetsReceived, packetsLost] = [100, 0];
    for (let second = 0; second < 25 && kinds().at(-1) !== "audio-only"; second++) {
      stats.set("v", { type: "inbound-rtp", kind: "video", packetsReceived: (packetsReceived += 10), packetsLost: (packetsLost += 10) });
      await seconds(1, 1);
    }
    expect(kinds().at(-1)).toBe("audio-only");
    await seconds(1);
    expect(flags() & 8).toBe(8);
    for (let second = 0; second < 30 && kinds().at(-1) !== "live"; second++) await seconds(1, 30);
    expect(kinds().at(-1)).toBe("live");
    await seconds(1, 30);
    expect(flags() & 8).toBe(0);
    live.close();
  });

  it("is refused for good where the meeting is gone", async () => {
    const { live, states, seconds } = setUp(() => json({ title: "No such meeting", detail: "gone" }, 404));
    await seconds(30);
    expect(states.at(-1)).toMatchObject({ kind: "refused", problem: { title: "No such meeting" } });
    expect(FakePeer.made).toHaveLength(1);
    live.close();
  });

  it("asks for a new seat once the old one is refused", async () => {
    let answers = 0;
    const { live, kinds, seats, seconds } = setUp(() =>
      ++answers === 1 ? json({ title: "Expired" }, 401) : new Response("answer", { status: 201 }),
    );
    await seconds(3);
    expect(seats).toEqual([false, true]);
    expect(kinds().at(-1)).toBe("preparing");
    live.close();
  });
});

describe("the viewpoint", () => {
  it("is sent when it moves, and often enough while it rests", async () => {
    const { live, seconds, sent } = setUp();
    await seconds(1);
    const before = sent().length;
    await seconds(2);
    const resting = sent().length - before;
    expect(resting).toBeGreaterThanOrEqual(4);
    expect(resting).toBeLessThanOrEqual(6);
    live.viewpoint.turn(1, 0);
    await vi.advanceTimersByTimeAsync(50);
    expect(sent().length - before).toBeGreaterThan(resting);
    const [last, earlier] = [sent().at(-1), sent()[before]];
    expect(last?.getFloat32(16, true)).not.toBeCloseTo(earlier?.getFloat32(16, true) ?? 0, 1);
    expect(last?.getUint32(4, true)).toBeGreaterThan(earlier?.getUint32(4, true) ?? 0);
    live.close();
  });

  it("says what is wanted: parts never filmed hidden or shown, and a stalled video", async () => {
    const { live, seconds, flags } = setUp();
    await seconds(2, 30);
    expect(flags()).toBe(1);
    live.setHideUnseen(false);
    videoFrame();
    await vi.advanceTimersByTimeAsync(100);
    expect(flags()).toBe(0);
    await vi.advanceTimersByTimeAsync(700);
    expect(flags()).toBe(4);
    live.close();
  });

  it("asks for a picture in the shape of the viewport", async () => {
    const { live, seconds, sent } = setUp();
    await seconds(1);
    const [width, height] = [sent().at(-1)?.getUint16(48, true) ?? 0, sent().at(-1)?.getUint16(50, true) ?? 1];
    expect(width / height).toBeCloseTo(800 / 600, 1);
    live.close();
  });
});

describe("the roster", () => {
  it("is asked for anew while the meeting is live", async () => {
    const { live, seconds, meeting, calls } = setUp();
    const shown: string[][] = [];
    live.onPerformers = (performers) => shown.push(performers.map(({ name }) => name));
    await seconds(12, 30);
    expect(calls.filter(({ path }) => path === "/v1/meetings/m")).toHaveLength(1);
    expect(shown.at(-1)).toEqual(["Ada", "Bo"]);
    expect(meeting.performers).toHaveLength(2);
    live.close();
  });

  it("says where heads are; nobody's where nobody stands", async () => {
    const { live } = setUp();
    expect(live.headPosition("ada")).toEqual([1, 0.95 + 0.65, 2]);
    expect(live.headPosition("nobody")).toBeNull();
    expect(live.listener).toEqual(live.viewpoint.camera);
    live.close();
  });
});

describe("leaving", () => {
  it("ends the session on the server, by `close` and when the page goes away", async () => {
    for (const leave of [(live: LiveView) => live.close(), () => window.dispatchEvent(new Event("pagehide"))]) {
      const { live, calls, seconds } = setUp();
      await seconds(1);
      leave(live);
      await seconds(5);
      expect(calls.filter(({ method }) => method === "DELETE").map(({ path }) => new URL(path, "http://h/").pathname)).toEqual(["/whep/m/1"]);
      expect(FakePeer.made.at(-1)?.closed).toBe(true);
      live.close();
    }
  });
});

describe("stats", () => {
  it("count the frames of each second, with their size and the round trip", async () => {
    const { live, seconds } = setUp();
    const told: object[] = [];
    await seconds(1);
    FakePeer.made[0]?.stats.set("v", { type: "inbound-rtp", kind: "video", framesDecoded: 30 });
    FakePeer.made[0]?.stats.set("p", { type: "candidate-pair", nominated: true, currentRoundTripTime: 0.02 });
    live.onStats = (stats) => told.push(stats);
    await seconds(1, 25);
    expect(told).toEqual([{ fps: 25, framesDecoded: 30, width: 512, height: 384, roundTripMs: 20 }]);
    live.close();
  });
});
