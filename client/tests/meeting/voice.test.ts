import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { SLOTS, VoiceConnection } from "../../src/meeting/voice";
import { fakeFetch } from "../fakes";

class FakeTrack {
  kind = "audio";
  enabled = true;
  readyState = "live";
  stop(): void {
    this.readyState = "ended";
  }
}

class FakePeer extends EventTarget {
  connectionState = "new";
  iceGatheringState = "complete";
  localDescription = { sdp: "offer" };
  sent: FakeTrack | null = null;
  closed = false;
  asked: string[] = [];
  addTransceiver(kind: string, { direction }: { direction: string }): object {
    this.asked.push(`${kind} ${direction}`);
    return {
      sender: { replaceTrack: async (track: FakeTrack) => void (this.sent = track) },
      receiver: { track: Object.assign(new FakeTrack(), { id: `track ${this.asked.length - 2}` }) },
    };
  }
  async createOffer(): Promise<object> {
    return {};
  }
  async setLocalDescription(): Promise<void> {}
  async setRemoteDescription(): Promise<void> {
    this.become("connected");
  }
  become(state: string): void {
    this.connectionState = state;
    this.dispatchEvent(new Event("connectionstatechange"));
  }
  stats: object[] = [];
  getStats = async (): Promise<Map<number, object>> => new Map(this.stats.entries());
  close(): void {
    this.closed = true;
  }
}

function setUp(status = 201) {
  const peers: FakePeer[] = [];
  const { request, calls } = fakeFetch((call) =>
    call.method === "POST"
      ? new Response("answer", { status, headers: { Location: `/voice/${peers.length}` } })
      : new Response(),
  );
  const heard: string[] = [];
  const asked: boolean[] = [];
  const hooks = {
    address: async (lost: boolean) => (asked.push(lost), "https://one.example/voice"),
    token: async () => "seat",
    onChange: () => heard.push([...link.slots].map(([slot, { memberId }]) => `${slot} ${memberId}`).join()),
  };
  const link: VoiceConnection = new VoiceConnection([], hooks, request, () => {
    peers.push(new FakePeer());
    return peers.at(-1) as unknown as RTCPeerConnection;
  });
  return { link, peers, calls, heard, asked };
}

describe("the voice connection", () => {
  let track: FakeTrack;
  beforeEach(() => {
    vi.useFakeTimers();
    track = new FakeTrack();
    vi.stubGlobal("MediaStream", class {
      constructor(readonly tracks: unknown[]) {}
      getAudioTracks = (): unknown[] => this.tracks;
    });
    vi.stubGlobal("navigator", {
      mediaDevices: { getUserMedia: async () => ({ getAudioTracks: () => [track] }) },
    });
  });
  afterEach(() => {
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });

  it("sends nothing of the microphone until it is opened, also on the next connection", async () => {
    const { link, peers } = setUp();
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    expect(peers[0]?.sent).toBeNull();
    await link.acquireMicrophone();
    expect(peers[0]?.sent).toBe(track);
    expect(track.enabled).toBe(false);
    link.setMicrophoneEnabled(true);
    expect(track.enabled).toBe(true);
    peers[0]?.become("failed");
    await vi.advanceTimersByTimeAsync(1000);
    expect(peers[0]?.closed).toBe(true);
    expect(peers[1]?.sent).toBe(track);
    link.close();
    expect(track.readyState).toBe("ended");
  });

  it("hears each speaker in a track of their own, and nobody once the connection is lost", async () => {
    const { link, peers, heard } = setUp();
    link.assignSlots([null, "bo"]);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    expect(peers[0]?.asked).toEqual([
      "audio sendonly",
      ...Array.from({ length: SLOTS }, () => "audio recvonly"),
      "video recvonly",
    ]);
    expect(heard.at(-1)).toBe("1 bo");
    expect(link.screen).not.toBeNull();
    const stream = link.slots.get(1)?.stream;
    link.assignSlots(["cy", "bo"]);
    expect(heard.at(-1)).toBe("0 cy,1 bo");
    expect(link.slots.get(1)?.stream).toBe(stream);
    const told = heard.length;
    link.assignSlots(["cy", "bo"]);
    expect(heard).toHaveLength(told);
    peers[0]?.become("failed");
    await vi.advanceTimersByTimeAsync(10);
    expect(heard).toContain("");
    expect(link.screen).toBeNull();
    await vi.advanceTimersByTimeAsync(1000);
    expect(heard.at(-1)).toBe("0 cy,1 bo");
    link.close();
  });

  it("moves on to where the meeting lives now", async () => {
    const { link, peers, calls, asked } = setUp();
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    link.reconnect();
    await vi.advanceTimersByTimeAsync(1000);
    expect(peers.map(({ closed }) => closed)).toEqual([true, false]);
    expect(asked).toEqual([false, true]);
    expect(calls.filter(({ method }) => method === "DELETE").map(({ path }) => path)).toEqual(["https://one.example/voice/1"]);
    link.close();
  });

  it("tells how long each voice waited since the last time, of those that are heard", async () => {
    const { link, peers } = setUp();
    link.assignSlots([null, "bo", "cy"]);
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    const voice = (slot: number, jitterBufferDelay: number, jitterBufferEmittedCount: number): object =>
      ({ type: "inbound-rtp", kind: "audio", trackIdentifier: `track ${slot}`, jitterBufferDelay, jitterBufferEmittedCount }); // prettier-ignore
    const tell = (...stats: object[]): void => void (peers[0] && (peers[0].stats = stats));
    tell(voice(1, 4800, 48_000), voice(2, 10, 480), voice(3, 0, 0), { type: "inbound-rtp", kind: "video" });
    expect([...(await link.bufferDelaysMs())]).toEqual([]);
    // half a second later: 80 ms each; cy is silent, and nobody has the track of number 3
    tell(voice(1, 4800 + 0.08 * 24_000, 72_000), voice(2, 10, 480), voice(3, 50, 960));
    expect([...(await link.bufferDelaysMs())]).toEqual([["bo", expect.closeTo(80, 6)]]);
    link.close();
    expect([...(await link.bufferDelaysMs())]).toEqual([]);
  });

  it("hangs up when closed", async () => {
    const { link, calls } = setUp();
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    link.close();
    await vi.advanceTimersByTimeAsync(10);
    expect(calls.map(({ method, path, token }) => `${method} ${path} ${token}`)).toEqual([
      "POST https://one.example/voice Bearer seat",
      "DELETE https://one.example/voice/1 Bearer seat",
    ]);
  });

  it("asks for nothing to be ended that the server ends by itself", async () => {
    const { link, calls, peers } = setUp();
    void link.run();
    await vi.advanceTimersByTimeAsync(10);
    link.close(true);
    await vi.advanceTimersByTimeAsync(10);
    expect(peers[0]?.closed).toBe(true);
    expect(calls.map(({ method }) => method)).toEqual(["POST"]);
  });

  it("stops asking where it is not let in, and goes on where the server is busy", async () => {
    const refused = setUp(403);
    await refused.link.run();
    expect(refused.calls).toHaveLength(1);
    const busy = setUp(503);
    void busy.link.run();
    await vi.advanceTimersByTimeAsync(3000);
    expect(busy.calls.length).toBeGreaterThan(2);
    busy.link.close();
  });

  it("says in words that there is no microphone", async () => {
    vi.stubGlobal("navigator", { mediaDevices: { getUserMedia: async () => Promise.reject(new DOMException("", "NotAllowedError")) } });
    await expect(setUp().link.acquireMicrophone()).rejects.toMatchObject({ title: "The microphone is blocked" });
  });
});
