import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Seat } from "../../src/api/types";
import { WhepConnection, backoffMs, type WhepState } from "../../src/transport/whep";
import { fakeFetch, json, type Call } from "../fakes";
import { FRONT } from "../viewpoint/front";

class FakeChannel extends EventTarget {
  readyState = "connecting";
  bufferedAmount = 0;
  sent: ArrayBuffer[] = [];
  constructor(
    readonly label: string,
    readonly options: RTCDataChannelInit,
  ) {
    super();
  }
  send(packet: ArrayBuffer): void {
    this.sent.push(packet);
  }
}

class FakeSender {
  track: object | null = null;
  parameters: object = {};
  getParameters(): object {
    return { transactionId: "1" };
  }
  async setParameters(parameters: object): Promise<void> {
    this.parameters = parameters;
  }
  async replaceTrack(track: object | null): Promise<void> {
    this.track = track;
  }
}

class FakePeer extends EventTarget {
  look = new FakeSender();
  lookEncodings: RTCRtpEncodingParameters[] = [];
  connectionState = "new";
  iceGatheringState = "complete";
  localDescription = { sdp: "offer" };
  steps: string[] = [];
  channel: FakeChannel | null = null;
  poses: FakeChannel | null = null;
  looks: FakeChannel | null = null;
  closed = false;
  createDataChannel(label: string, options: RTCDataChannelInit): FakeChannel {
    this.steps.push(label);
    const made = new FakeChannel(label, options);
    if (label === "view") this.channel = made;
    else if (label === "pose") this.poses = made;
    else this.looks = made;
    return made;
  }
  addTransceiver(kind: string, { direction, sendEncodings = [] }: RTCRtpTransceiverInit): object {
    this.steps.push(`${kind} ${direction}`);
    if (direction === "sendonly") this.lookEncodings = sendEncodings;
    return { receiver: {}, sender: this.look };
  }
  async createOffer(): Promise<object> {
    this.steps.push("offer");
    return {};
  }
  async setLocalDescription(): Promise<void> {}
  async setRemoteDescription({ sdp }: { sdp: string }): Promise<void> {
    this.steps.push(sdp);
    this.become("connected");
  }
  become(state: string): void {
    this.connectionState = state;
    this.dispatchEvent(new Event("connectionstatechange"));
  }
  async getStats(): Promise<Map<string, object>> {
    return new Map<string, object>([
      ["v", { type: "inbound-rtp", kind: "video", framesDecoded: 10, packetsReceived: 90, packetsLost: 7 }],
      ["p", { type: "candidate-pair", nominated: true, currentRoundTripTime: 0.004 }],
    ]);
  }
  close(): void {
    this.closed = true;
  }
}

const SEAT: Seat = {
  token: "seat",
  participant_id: "me",
  seat: 1,
  role: "speaker",
  admission: "admitted",
  gateway_url: "https://one.example",
  control_url: "https://one.example/v1/meetings/m/control",
  ready: true,
  ice_servers: [{ urls: ["turn:s"], username: "9:me", credential: "c" }],
  whep_url: "https://one.example/whep/m",
  performers: [],
  viewpoint: FRONT,
};

function setUp(answer: (call: Call, attempt: number) => Response, dataOnly = false) {
  const peers: FakePeer[] = [];
  const states: WhepState[] = [];
  const heard: ArrayBuffer[] = [];
  const looks: ArrayBuffer[] = [];
  const asked: boolean[] = [];
  let attempt = 0;
  let seats = 0;
  const { request, calls } = fakeFetch((call) =>
    call.method === "DELETE" ? new Response() : answer(call, attempt++),
  );
  const hooks = {
    dataOnly,
    // as a MeetingSession keeps it
    seat: async (stale: boolean) => ({ ...SEAT, token: `seat${stale || seats === 0 ? ++seats : seats}` }),
    address: async (lost: boolean) => (asked.push(lost), "https://one.example/whep/m"),
    onState: (state: WhepState) => states.push(state),
    onStream: () => undefined,
    onPose: (packet: ArrayBuffer) => heard.push(packet),
    onLook: (packet: ArrayBuffer) => looks.push(packet),
  };
  const configurations: RTCConfiguration[] = [];
  const link = new WhepConnection(hooks, request, (configuration) => {
    configurations.push(configuration);
    const peer = new FakePeer();
    peers.push(peer);
    return peer as unknown as RTCPeerConnection;
  });
  const kinds = (): string[] => states.map(({ kind }) => kind);
  return { link, calls, peers, states, kinds, heard, looks, configurations, asked };
}

const accepted = (): Response =>
  new Response("answer", { status: 201, headers: { Location: "/whep/m/7" } });

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("VideoDecoder", class {});
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("WhepConnection", () => {
  it("offers one video to receive, a place for pictures of oneself, and channels for viewpoints and poses", async () => {
    const { link, calls, peers, kinds, configurations } = setUp(accepted);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    const peer = peers[0];
    expect(configurations[0]?.iceServers).toEqual(SEAT.ice_servers);
    expect(peer?.steps).toEqual(["view", "pose", "look", "video recvonly", "video sendonly", "offer", "answer"]);
    expect(peer?.channel?.label).toBe("view");
    expect(peer?.channel?.options).toEqual({ ordered: false, maxRetransmits: 0 });
    expect(calls[0]).toMatchObject({ method: "POST", path: "https://one.example/whep/m", token: "Bearer seat1" });
    expect(calls[0]?.body).toBe("offer");
    expect(kinds()).toEqual(["connecting", "live"]);
    link.close();
  });

  it("offers channels alone where poses alone are wanted, and sends no picture however it is asked to", async () => {
    const { link, peers, kinds } = setUp(accepted, true);
    link.setLookTrack({} as MediaStreamTrack);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    expect(peers[0]?.steps).toEqual(["view", "pose", "offer", "answer"]);
    link.setLookTrack({} as MediaStreamTrack);
    expect(peers[0]?.look.track).toBeNull();
    expect(kinds()).toEqual(["connecting", "live"]);
    link.close();
  });

  it("asks where to go once a connection was lost", async () => {
    const { link, peers, asked } = setUp(accepted);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    peers[0]?.become("failed");
    await vi.advanceTimersByTimeAsync(5000);
    expect(asked).toEqual([false, true]);
    link.close();
  });

  it("sends pictures of oneself once there are any, over each connection, until there are none", async () => {
    const { link, peers } = setUp(accepted);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    expect(peers[0]?.look).toMatchObject({ track: null, parameters: { degradationPreference: "maintain-resolution" } });
    expect(peers[0]?.lookEncodings).toMatchObject([{ maxBitrate: 225_000, maxFramerate: 15, priority: "very-low" }]);
    const track = {} as MediaStreamTrack;
    link.setLookTrack(track);
    expect(peers[0]?.look.track).toBe(track);
    peers[0]?.become("failed");
    await vi.advanceTimersByTimeAsync(5000);
    expect(peers[1]?.look.track).toBe(track);
    link.setLookTrack(null);
    expect(peers[1]?.look.track).toBeNull();
    link.close();
  });

  it("hands on what comes down the channels for poses and for live look, which loses nothing", async () => {
    const { link, peers, heard, looks } = setUp(accepted);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    const data = new ArrayBuffer(176);
    expect(peers[0]?.poses).toMatchObject({ label: "pose", options: { ordered: false, protocol: "batches" } });
    peers[0]?.poses?.dispatchEvent(new MessageEvent("message", { data }));
    expect(heard).toEqual([data]);
    const batch = Uint8Array.from([1, 7, 176, ...new Uint8Array(176), 176, ...new Uint8Array(176)]).buffer;
    peers[0]?.poses?.dispatchEvent(new MessageEvent("message", { data: batch }));
    expect(heard).toEqual([data, data, data]);
    const picture = new ArrayBuffer(900);
    expect(peers[0]?.looks).toMatchObject({ label: "look", options: undefined });
    peers[0]?.looks?.dispatchEvent(new MessageEvent("message", { data: picture }));
    expect([heard.length, looks]).toEqual([3, [picture]]);
    link.close();
  });

  it("asks for no live look of others where this browser could not decode it", async () => {
    vi.stubGlobal("VideoDecoder", undefined);
    const { link, peers } = setUp(accepted);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    expect(peers[0]?.steps.slice(0, 3)).toEqual(["view", "pose", "video recvonly"]);
    link.close();
  });

  it("sends nothing through a channel that is shut or clogged", async () => {
    const { link, peers } = setUp(accepted);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    const channel = peers[0]?.channel as FakeChannel;
    const packet = new ArrayBuffer(52);
    expect(link.send(packet)).toBe(false);
    channel.readyState = "open";
    expect(link.send(packet)).toBe(true);
    channel.bufferedAmount = 10_000;
    expect(link.send(packet)).toBe(false);
    expect(channel.sent).toEqual([packet]);
    link.close();
  });

  it.each([
    ["a failed connection", (peer: FakePeer) => peer.become("failed")],
    ["a channel closed by the server", (peer: FakePeer) => peer.channel?.dispatchEvent(new Event("close"))],
    ["a silence that lasts", (peer: FakePeer) => peer.become("disconnected")],
  ])("makes a new connection after %s, and counts pictures on", async (_, breakIt) => {
    const { link, peers, calls, kinds } = setUp(accepted);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    expect(await link.stats()).toEqual({ framesDecoded: 10, roundTripMs: 4, received: 90, lost: 7 });
    breakIt(peers[0] as FakePeer);
    await vi.advanceTimersByTimeAsync(5000);
    expect(peers).toHaveLength(2);
    expect(peers[0]?.closed).toBe(true);
    expect(kinds()).toEqual(["connecting", "live", "reconnecting", "live"]);
    expect((await link.stats()).framesDecoded).toBe(20);
    expect(calls.filter(({ method }) => method === "DELETE")[0]?.path).toMatch(/\/whep\/m\/7$/);
    const posts = calls.filter(({ method }) => method === "POST");
    expect(posts.map(({ token }) => token)).toEqual(["Bearer seat1", "Bearer seat2"]);
    link.close();
  });

  it("gets over a short silence without a new connection", async () => {
    const { link, peers } = setUp(accepted);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    peers[0]?.become("disconnected");
    await vi.advanceTimersByTimeAsync(1000);
    peers[0]?.become("connected");
    await vi.advanceTimersByTimeAsync(10_000);
    expect(peers).toHaveLength(1);
    link.close();
  });

  it("waits as long as a full server asks, and says why", async () => {
    const full = (): Response =>
      new Response(JSON.stringify({ title: "The server is full" }), {
        status: 503,
        headers: { "Retry-After": "20" },
      });
    const { link, states, calls } = setUp((_, attempt) => (attempt === 0 ? full() : accepted()));
    void link.run();
    await vi.advanceTimersByTimeAsync(15_000);
    link.retryNow();
    await vi.advanceTimersByTimeAsync(100);
    expect(calls).toHaveLength(1);
    expect(states.at(-1)).toMatchObject({
      kind: "reconnecting",
      problem: { title: "The server is full" },
    });
    await vi.advanceTimersByTimeAsync(6_000);
    expect(states.at(-1)?.kind).toBe("live");
    link.close();
  });

  it("comes back at once when it hears that the server is there again", async () => {
    let away = false;
    const { link, peers, calls, kinds } = setUp(() => {
      if (away) throw new TypeError("no network");
      return accepted();
    });
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    away = true;
    peers[0]?.become("failed");
    await vi.advanceTimersByTimeAsync(20_000); // pauses have grown to eight seconds by now
    away = false;
    const tried = calls.length;
    link.retryNow();
    await vi.advanceTimersByTimeAsync(10);
    expect(calls).toHaveLength(tried + 1);
    expect(kinds().at(-1)).toBe("live");
    link.close();
  });

  it("takes a new seat when the old one has run out", async () => {
    const { link, calls, kinds } = setUp((_, attempt) =>
      attempt === 0 ? json({ title: "Token expired" }, 401) : accepted(),
    );
    void link.run();
    await vi.advanceTimersByTimeAsync(2000);
    expect(calls.map(({ token }) => token)).toEqual(["Bearer seat1", "Bearer seat2"]);
    expect(kinds().at(-1)).toBe("live");
    link.close();
  });

  it("ends with the reason when the meeting is gone", async () => {
    const { link, states, calls } = setUp(() => json({ title: "This meeting is over" }, 404));
    await link.run();
    expect(states.at(-1)).toMatchObject({
      kind: "refused",
      problem: { title: "This meeting is over" },
    });
    await vi.advanceTimersByTimeAsync(60_000);
    expect(calls).toHaveLength(1);
  });

  it("does not knock for ever at a door that stays shut", async () => {
    const { link, calls, states } = setUp(() => json({ title: "Not invited" }, 403));
    void link.run();
    await vi.advanceTimersByTimeAsync(120_000);
    expect(calls.length).toBeLessThan(5);
    expect(states.at(-1)?.kind).toBe("refused");
    link.close();
  });

  it("says goodbye when left, and stays away", async () => {
    const { link, calls, peers } = setUp(accepted);
    const running = link.run();
    await vi.advanceTimersByTimeAsync(10);
    link.close();
    await running;
    await vi.advanceTimersByTimeAsync(60_000);
    expect(peers).toHaveLength(1);
    expect(peers[0]?.closed).toBe(true);
    expect(calls.map(({ method }) => method)).toEqual(["POST", "DELETE"]);
  });
});

describe("backoffMs", () => {
  it("doubles up to eight seconds and spreads", () => {
    expect([0, 1, 2, 3, 4, 9].map((n) => backoffMs(n, 0.5))).toEqual([500, 1000, 2000, 4000, 8000, 8000]);
    expect(backoffMs(0, 0)).toBeLessThan(backoffMs(0, 1));
  });
});
