import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { ControlConnection, lostText, reconnectDelayMs, type ControlState } from "../../src/meeting/controlConnection";
import { NO_SERVER, Problem } from "../../src/api/problem";
import type { FromServer, ToServer } from "../../src/api/types";

class FakeSocket {
  static readonly OPEN = 1;
  readyState = 1;
  sent: ToServer[] = [];
  onopen: () => void = () => undefined;
  onmessage: (event: { data: string }) => void = () => undefined;
  onclose: () => void = () => undefined;
  constructor(readonly address: string) {}
  send(text: string): void {
    this.sent.push(JSON.parse(text) as ToServer);
  }
  close(): void {
    if (this.readyState === 3) return;
    this.readyState = 3;
    this.onclose();
  }
  tell(message: FromServer): void {
    this.onmessage({ data: JSON.stringify(message) });
  }
  welcome(): void {
    this.onopen();
    this.tell({ type: "welcome", participant_id: "me", seat: 1, silence_s: 5 });
  }
}

function setUp(greeting?: (stale: boolean) => Promise<never>) {
  const sockets: FakeSocket[] = [];
  const states: ControlState[] = [];
  const messages: FromServer[] = [];
  const asked: boolean[] = [];
  const roundTrips: number[] = [];
  const line = new ControlConnection(
    {
      hello: async (stale) => {
        asked.push(stale);
        if (greeting) return greeting(stale);
        return { address: "ws://x/c", token: "t", name: "Ada", after: messages.length };
      },
      onMessage: (message) => messages.push(message),
      onState: (state) => states.push(state),
      onRoundTrip: (milliseconds) => roundTrips.push(milliseconds),
    },
    (address) => {
      sockets.push(new FakeSocket(address));
      return sockets.at(-1) as unknown as WebSocket;
    },
  );
  const kinds = (): string[] => states.map(({ kind }) => kind);
  const newest = async (count: number): Promise<FakeSocket> => {
    while (sockets.length < count) await vi.advanceTimersByTimeAsync(50);
    return sockets[count - 1] as FakeSocket;
  };
  return { line, sockets, states, messages, asked, roundTrips, kinds, newest };
}

describe("ControlConnection", () => {
  beforeEach(() => {
    vi.useFakeTimers();
    vi.stubGlobal("WebSocket", FakeSocket);
  });
  afterEach(() => {
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });

  it("says hello, then beats once a second", async () => {
    const { line, newest, kinds } = setUp();
    void line.run();
    const socket = await newest(1);
    expect(line.send({ type: "hand", raised: true })).toBe(false);
    socket.welcome();
    expect(kinds()).toEqual(["connecting", "open"]);
    await vi.advanceTimersByTimeAsync(2100);
    expect(socket.sent).toEqual([
      { type: "hello", token: "t", name: "Ada", after: 0 },
      { type: "beat" },
      { type: "beat" },
    ]);
    expect(line.send({ type: "hand", raised: true })).toBe(true);
    line.close();
  });

  it("measures how long a beat takes to come back, each once", async () => {
    const { line, newest, roundTrips } = setUp();
    void line.run();
    const socket = await newest(1);
    socket.welcome();
    await vi.advanceTimersByTimeAsync(1080);
    socket.tell({ type: "beat" });
    socket.tell({ type: "beat" });
    expect(roundTrips).toEqual([80]);
    // one that is late counts from when it was sent
    await vi.advanceTimersByTimeAsync(2520);
    socket.tell({ type: "beat" });
    expect(roundTrips).toEqual([80, 1600]);
    line.close();
  });

  it("takes five silent seconds for a cut, and comes back within three after an outage", async () => {
    const { line, sockets, newest, kinds } = setUp();
    void line.run();
    (await newest(1)).welcome();
    await vi.advanceTimersByTimeAsync(4900);
    expect(sockets[0]?.readyState).toBe(1);
    await vi.advanceTimersByTimeAsync(200);
    expect(sockets[0]?.readyState).toBe(3);
    expect(kinds()).toEqual(["connecting", "open", "lost"]);
    // ten seconds without a network: every attempt fails at once
    for (const end = Date.now() + 10_000; Date.now() < end; ) {
      await vi.advanceTimersByTimeAsync(50);
      sockets.at(-1)?.close();
    }
    const attempts = sockets.length;
    const back = Date.now();
    const socket = await newest(attempts + 1);
    expect(Date.now() - back).toBeLessThanOrEqual(3000);
    socket.welcome();
    expect(kinds().at(-1)).toBe("open");
    expect(socket.sent[0]).toMatchObject({ type: "hello", after: 1 });
    line.close();
  });

  it("asks for another seat where its own was given back, and goes on after a silence or elsewhere", async () => {
    const { line, newest, asked } = setUp();
    void line.run();
    const first = await newest(1);
    first.onopen();
    first.tell({ type: "goodbye", reason: "given-back", problem: null });
    first.close();
    const second = await newest(2);
    second.welcome();
    second.tell({ type: "goodbye", reason: "silent", problem: null });
    second.close();
    const third = await newest(3);
    third.tell({ type: "goodbye", reason: "moved", problem: null });
    third.close();
    await newest(4);
    expect(asked).toEqual([false, true, false, false]);
    line.close();
  });

  it.each(["removed", "denied", "ended", "replaced", "left"] as const)(
    "ends for good when it hears %s",
    async (reason) => {
      const { line, newest, states, sockets } = setUp();
      void line.run();
      const socket = await newest(1);
      socket.welcome();
      socket.tell({ type: "goodbye", reason, problem: null });
      socket.close();
      await vi.advanceTimersByTimeAsync(5000);
      expect(states.at(-1)).toEqual({ kind: "ended", reason, problem: null });
      expect(sockets).toHaveLength(1);
    },
  );

  it("tries on while the server is away, and tells what refuses it", async () => {
    let away = 3;
    const over = new Problem("Meeting over", "It was ended.", 410);
    const { line, states, kinds } = setUp(async () => {
      throw away-- > 0 ? NO_SERVER : over;
    });
    const running = line.run();
    await vi.advanceTimersByTimeAsync(5000);
    await running;
    expect(kinds()).toEqual(["connecting", "lost", "lost", "lost", "ended"]);
    expect(states.at(-1)).toMatchObject({ reason: "refused", problem: over });
  });

  it("waits as long as a busy server asks, says so, and tries again", async () => {
    const answers = [
      new Problem("Too many requests", "Come back in 20 s.", 429, 20),
      new Problem("Too many requests", "Come back.", 429),
    ];
    let attempts = 0;
    const { line, states, kinds } = setUp(async () => {
      attempts++;
      throw answers.shift() ?? new Problem("Meeting over", "It was ended.", 410);
    });
    const running = line.run();
    await vi.advanceTimersByTimeAsync(19_900);
    expect(attempts).toBe(1);
    expect(states.at(-1)).toEqual({ kind: "lost", waitS: 20 });
    expect(lostText({ kind: "lost", waitS: 20 })).toBe("Too many requests. Trying again in 20 s");
    await vi.advanceTimersByTimeAsync(1200);
    expect(attempts).toBe(2);
    await vi.advanceTimersByTimeAsync(6000);
    await running;
    expect(attempts).toBe(3);
    expect(kinds()).toEqual(["connecting", "lost", "lost", "ended"]);
  });

  it("waits longer between attempts, but never long", () => {
    expect(reconnectDelayMs(0, 0)).toBeLessThan(200);
    expect(reconnectDelayMs(20, 1)).toBe(1000);
  });
});
