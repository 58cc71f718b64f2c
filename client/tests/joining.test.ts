// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { fakeFetch, json, member, type Call } from "./fakes";
import { FakeSocket } from "./fakeSocket";
import { FRONT } from "./viewpoint/front";

const MEETING = { id: "m", name: "Monday", join_url: "/?meeting=m", environment: "studio", performers: [], viewpoint: FRONT, lobby: false };
const OFFERS = ["/whep/m", "/v1/meetings/m/voice"];

/** A server whose seats are given back with the view, unless the control channel has taken them up. */
class FakeServer {
  taken = new Set<string>();
  heard = new Set<string>();
  seats = 0;
  refused: string[] = [];
  accepted: string[] = [];

  answer({ method, path, token }: Call): Response {
    const seat = token?.replace("Bearer ", "") ?? "";
    const where = new URL(path, location.href).pathname;
    if (where === "/v1/guest") return json({ token: "guest" });
    if (where === "/v1/meetings/m") return json(MEETING);
    if (where.endsWith("/home")) return json({ gateway_url: "" });
    if (where.endsWith("/join")) return this.join();
    if (method === "DELETE" && where.startsWith("/whep/m/")) {
      if (!this.heard.has(seat)) this.taken.delete(seat);
      return new Response();
    }
    if (method !== "POST" || !OFFERS.includes(where)) return json({ items: [] });
    (this.taken.has(seat) ? this.accepted : this.refused).push(`${where} ${seat}`);
    return this.taken.has(seat)
      ? new Response("answer", { status: 201, headers: { Location: `${where}/1` } })
      : json({ title: "Seat released", detail: "join again" }, 403);
  }

  hello(token: string): object[] {
    if (!this.taken.has(token)) return [{ type: "goodbye", reason: "given-back", problem: null }];
    this.heard.add(token);
    const roster = { lobby: false, environment: "studio", presenter_id: null, presenter_asks_id: null, recording: null, members: [member({ id: token })], performer_ids: [] };
    return [{ type: "welcome", participant_id: token, seat: 1, silence_s: 5 }, { type: "roster", ...roster }];
  }

  private join(): Response {
    const token = `seat${++this.seats}`;
    this.taken.add(token);
    return json({ token, gateway_url: "", control_url: "/v1/meetings/m/control", whep_url: "/whep/m", ice_servers: [], ready: true, performers: [], viewpoint: FRONT });
  }
}

let server: FakeServer;

class ControlSocket extends FakeSocket {
  static made: ControlSocket[] = [];
  constructor() {
    super();
    ControlSocket.made.push(this);
  }
  send(text: string): void {
    const said = JSON.parse(text) as { type: string; token: string };
    if (said.type === "hello") server.hello(said.token).forEach((message) => this.say(message));
    if (said.type === "hello" && !server.heard.has(said.token)) this.close();
  }
  close(): void {
    if (this.readyState === 3) return;
    this.readyState = 3;
    this.onclose();
  }
}

class FakePeer extends EventTarget {
  static made: FakePeer[] = [];
  connectionState = "new";
  iceGatheringState = "complete";
  localDescription = { sdp: "offer" };
  constructor() {
    super();
    FakePeer.made.push(this);
  }
  createDataChannel = (): object => Object.assign(new EventTarget(), { readyState: "open", bufferedAmount: 0, send: () => undefined });
  addTransceiver = (): object => ({
    receiver: { track: {} },
    sender: { getParameters: () => ({}), setParameters: async () => undefined, replaceTrack: async () => undefined },
  });
  createOffer = async (): Promise<object> => ({});
  setLocalDescription = async (): Promise<void> => undefined;
  setRemoteDescription = async (): Promise<void> => this.become("connected");
  getStats = async (): Promise<Map<string, object>> => new Map();
  close = (): void => undefined;
  become(state: string): void {
    this.connectionState = state;
    this.dispatchEvent(new Event("connectionstatechange"));
  }
}

beforeEach(() => {
  vi.useFakeTimers();
  sessionStorage.clear();
  localStorage.clear();
  server = new FakeServer();
  ControlSocket.made = [];
  FakePeer.made = [];
  vi.stubGlobal("fetch", fakeFetch((call) => server.answer(call)).request);
  vi.stubGlobal("WebSocket", ControlSocket);
  vi.stubGlobal("RTCPeerConnection", FakePeer);
  vi.stubGlobal("MediaStream", class {});
  const param = { setTargetAtTime: () => undefined };
  vi.stubGlobal("AudioContext", class {
    listener = Object.fromEntries(["position", "forward", "up"].flatMap((name) => ["X", "Y", "Z"].map((axis) => [name + axis, param])));
    createMediaStreamDestination = (): object => ({ stream: {} });
    resume = async (): Promise<void> => undefined;
    close = async (): Promise<void> => undefined;
  });
  vi.stubGlobal("Worker", class extends EventTarget {
    postMessage = (): void => undefined;
    terminate = (): void => undefined;
  });
  vi.stubGlobal("scrollTo", () => undefined);
  HTMLVideoElement.prototype.requestVideoFrameCallback = () => 1;
  HTMLVideoElement.prototype.cancelVideoFrameCallback = () => undefined;
  HTMLMediaElement.prototype.play = async () => undefined;
  Object.defineProperty(HTMLMediaElement.prototype, "srcObject", { writable: true, value: null, configurable: true });
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("has picture and voices on the seat that we sit on, though the preview breaks off as one joins", async () => {
  history.replaceState(null, "", "/?meeting=m");
  document.body.innerHTML = '<div id="page"></div><div id="announcer"></div>';
  vi.resetModules();
  await import("../src/main");
  await vi.advanceTimersByTimeAsync(100);
  expect(server.accepted).toEqual(["/whep/m seat1"]);
  // the view's end gives the seat back, and nothing has taken it up yet
  FakePeer.made.at(-1)?.become("failed");
  document.querySelector("[data-testid=start-join]")?.closest("form")?.dispatchEvent(new Event("submit", { cancelable: true }));
  await vi.advanceTimersByTimeAsync(50);
  expect([...server.taken]).toEqual([]);
  for (let look = 0; look < 6; look++) {
    ControlSocket.made.filter(({ readyState }) => readyState === 1).forEach((socket) => socket.onopen());
    await vi.advanceTimersByTimeAsync(250);
  }
  expect([...server.heard]).toEqual(["seat2"]);
  expect(server.refused).toEqual([]);
  expect(server.accepted.slice(1).sort()).toEqual(["/v1/meetings/m/voice seat2", "/whep/m seat2"]);
});
