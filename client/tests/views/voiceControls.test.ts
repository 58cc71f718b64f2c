// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { voiceControls } from "../../src/views/voiceControls";
import { BO, HOST, inside } from "./inside";

class FakeTrack extends EventTarget {
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
  addTransceiver = (): object => ({ sender: { replaceTrack: async () => undefined }, receiver: { track: new FakeTrack() } });
  createOffer = async (): Promise<object> => ({});
  setLocalDescription = async (): Promise<void> => undefined;
  async setRemoteDescription(): Promise<void> {
    this.connectionState = "connected";
    this.dispatchEvent(new Event("connectionstatechange"));
  }
  close = (): void => undefined;
  waitedS = 0;
  getStats = async (): Promise<Map<string, object>> => {
    this.waitedS += 0.12 * 48_000;
    const told = { type: "inbound-rtp", kind: "audio", trackIdentifier: "0" };
    return new Map([["", { ...told, jitterBufferDelay: this.waitedS, jitterBufferEmittedCount: this.waitedS / 0.12 }]]);
  };
}

const OFF = { ...HOST, microphone: false };
let close: () => void = () => undefined;

interface Given {
  unmuted?: boolean;
  getUserMedia?: () => Promise<unknown>;
  getSeat?: () => Promise<never>;
  heldSeat?: () => Promise<never>;
}

async function setUp({ unmuted = false, getUserMedia, heldSeat, getSeat = async () => ({ token: "seat", ice_servers: [] }) as never }: Given = {}) {
  const track = new FakeTrack();
  const asked = vi.fn(getUserMedia ?? (async () => ({ getAudioTracks: () => [track], getTracks: () => [track] })));
  vi.stubGlobal("navigator", Object.assign(Object.create(navigator), { mediaDevices: { getUserMedia: asked } }));
  const there = inside();
  there.session.getSeat = getSeat;
  there.session.heldSeat = heldSeat ?? getSeat;
  there.session.joinsUnmuted = unmuted;
  const errors: string[] = [];
  const controls = voiceControls(there.session, (words) => errors.push(words), () => undefined);
  close = controls.close;
  document.body.append(controls.element);
  there.session.subscribe(controls.update);
  there.state({ kind: "open" });
  there.roster({ members: [OFF, BO] });
  await vi.advanceTimersByTimeAsync(50);
  const space = (kind: string, on: EventTarget = document.body, init: KeyboardEventInit = {}): void =>
    void on.dispatchEvent(new KeyboardEvent(kind, { code: "Space", bubbles: true, cancelable: true, ...init }));
  const wanted = (): unknown[] => there.sent.filter(({ type }) => type === "microphone").map((message) => "on" in message && message.on);
  const settle = async (): Promise<void> => void (await vi.advanceTimersByTimeAsync(10));
  return { ...there, ...controls, track, asked, errors, space, wanted, settle };
}

beforeEach(() => {
  vi.useFakeTimers();
  document.body.innerHTML = '<div id="announcer"></div>';
  vi.stubGlobal("RTCPeerConnection", FakePeer);
  vi.stubGlobal("fetch", async () => new Response("answer", { status: 201 }));
  vi.stubGlobal("MediaStream", class {});
  vi.stubGlobal("AudioContext", class {
    state = "running";
    createMediaStreamDestination = (): object => ({ stream: {} });
    close = async (): Promise<void> => undefined;
  });
  Object.defineProperty(HTMLMediaElement.prototype, "srcObject", { writable: true, value: null, configurable: true });
  HTMLMediaElement.prototype.play = async () => undefined;
});
afterEach(() => {
  close();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("the others' voices", () => {
  it("tell how late each performer is heard, with what the loudspeaker takes", async () => {
    const param = { setTargetAtTime: () => undefined };
    const node = Object.fromEntries(["position", "forward", "up"].flatMap((name) => ["X", "Y", "Z"].map((axis) => [name + axis, param])));
    const place = { ...node, connect: (to: object) => to, disconnect: () => undefined };
    vi.stubGlobal("AudioContext", class {
      state = "running";
      outputLatency = 0.025;
      listener = place;
      createMediaStreamDestination = (): object => ({ stream: {} });
      createMediaStreamSource = (): object => place;
      createPanner = (): object => ({ ...place });
      close = async (): Promise<void> => undefined;
    });
    vi.stubGlobal("MediaStream", class {
      getAudioTracks = (): object[] => [{ id: "0" }];
    });
    const { spatialiseIn, roster, hear, settle } = await setUp();
    roster({ members: [OFF, { ...BO, performer_id: "bo's model" }] });
    hear({ type: "speaking", participant_ids: [], slots: [BO.id] });
    const told: [string, number][][] = [];
    const room = {
      listener: { position: [0, 0, 0], wxyz: [1, 0, 0, 0] } as const,
      headPosition: () => null,
      setVoiceDelays: (delaysMs: ReadonlyMap<string, number>) => void told.push([...delaysMs]),
    };
    spatialiseIn(room);
    await vi.advanceTimersByTimeAsync(2100);
    await settle();
    expect(told.at(-1)).toEqual([["bo's model", expect.closeTo(120 + 25, 6)]]);
  });
});

describe("the connection of voices", () => {
  it("is asked for on the seat that the control connection holds, which a preview's end does not give back", async () => {
    const tokens: (string | null)[] = [];
    vi.stubGlobal("fetch", async (_: unknown, init: RequestInit) => {
      tokens.push(new Headers(init.headers).get("Authorization"));
      return new Response("answer", { status: 201 });
    });
    let token = "the preview's";
    let hold: (seat: never) => void = () => undefined;
    const seat = (): never => ({ token, ice_servers: [] }) as never;
    const { settle } = await setUp({ getSeat: async () => seat(), heldSeat: () => new Promise((resolve) => (hold = resolve)) });
    expect(tokens).toEqual([]);
    token = "held";
    hold(seat());
    await settle();
    expect(tokens).toEqual(["Bearer held"]);
  });
});

describe("the microphone's button", () => {
  it("asks for no microphone before it is pressed, and sends nothing before the server agrees", async () => {
    const { element, asked, track, roster, wanted, settle } = await setUp();
    expect(asked).not.toHaveBeenCalled();
    element.click();
    await settle();
    expect([asked.mock.calls.length, wanted(), track.enabled]).toEqual([1, [true], false]);
    roster({ members: [HOST, BO] });
    expect([track.enabled, element.getAttribute("aria-pressed")]).toEqual([true, "true"]);
    element.click();
    await settle();
    expect([track.enabled, wanted()]).toEqual([false, [true, false]]);
  });

  it("says so when the host mutes one, and stays off", async () => {
    const { element, track, roster, settle } = await setUp();
    element.click();
    await settle();
    roster({ members: [HOST, BO] });
    roster({ members: [OFF, BO] });
    expect([track.enabled, element.getAttribute("aria-pressed")]).toEqual([false, "false"]);
    expect(document.getElementById("announcer")?.textContent).toBe("The host muted you");
  });

  it("says what to do where the microphone is blocked", async () => {
    const { element, errors, wanted, settle } = await setUp({ getUserMedia: () => Promise.reject(new DOMException("no", "NotAllowedError")) });
    element.click();
    await settle();
    expect(errors).toEqual([expect.stringContaining("The microphone is blocked. Allow it")]);
    expect(wanted()).toEqual([]);
  });

  it("is on from the start where one joins unmuted", async () => {
    const { wanted, session } = await setUp({ unmuted: true });
    expect([wanted(), session.joinsUnmuted]).toEqual([[true], false]);
  });

  it("asks again for the microphone after the connection was lost", async () => {
    const { element, state, roster, wanted, settle } = await setUp();
    element.click();
    await settle();
    roster({ members: [HOST, BO] });
    state({ kind: "lost" });
    state({ kind: "open" });
    expect(wanted()).toEqual([true, true]);
  });

  it("pressed before there is a connection is heard as soon as there is one", async () => {
    let admit: (seat: never) => void = () => undefined;
    const getSeat = (): Promise<never> => new Promise((resolve) => (admit = resolve));
    const { element, track, asked, roster, wanted, settle } = await setUp({ getSeat });
    element.click();
    await settle();
    expect([asked.mock.calls.length, wanted()]).toEqual([0, []]);
    admit({ token: "seat", ice_servers: [] } as never);
    await settle();
    expect([asked.mock.calls.length, wanted()]).toEqual([1, [true]]);
    roster({ members: [HOST, BO] });
    expect([track.enabled, element.getAttribute("aria-pressed")]).toEqual([true, "true"]);
  });

  it("is not held up by a connection that was closed while it took the microphone", async () => {
    vi.stubGlobal("RTCPeerConnection", class extends FakePeer {
      override addTransceiver = (): object => ({ sender: { replaceTrack: () => new Promise(() => undefined) }, receiver: { track: new FakeTrack() } });
    });
    const { element, wanted, settle } = await setUp();
    element.click();
    await settle();
    expect(wanted()).toEqual([true]);
  });

  it("is not for viewers", async () => {
    const { element, roster } = await setUp();
    roster({ members: [{ ...OFF, role: "viewer" }, BO] });
    expect(element.disabled).toBe(true);
  });
});

describe("Space", () => {
  it("held down talks, and no longer", async () => {
    const { space, wanted, roster, settle } = await setUp();
    space("keydown");
    await settle();
    roster({ members: [HOST, BO] });
    space("keydown", document.body, { repeat: true });
    space("keyup");
    await settle();
    expect(wanted()).toEqual([true, false]);
  });

  it("let go of before the microphone was there keeps it off", async () => {
    let open: (stream: unknown) => void = () => undefined;
    const { space, wanted, track, settle } = await setUp({ getUserMedia: () => new Promise((resolve) => (open = resolve)) });
    space("keydown");
    space("keyup");
    open({ getAudioTracks: () => [track], getTracks: () => [track] });
    await settle();
    expect(wanted()).toEqual([false]);
    expect(track.enabled).toBe(false);
  });

  it("is left to fields and buttons", async () => {
    const { space, wanted, settle } = await setUp();
    for (const tag of ["input", "textarea", "button"]) space("keydown", document.body.appendChild(document.createElement(tag)));
    await settle();
    expect(wanted()).toEqual([]);
  });
});

describe("leaving", () => {
  it("switches the microphone off, and Space talks no more", async () => {
    const { element, track, space, wanted, settle } = await setUp();
    element.click();
    await settle();
    close();
    expect(track.readyState).toBe("ended");
    space("keydown");
    await settle();
    expect(wanted()).toEqual([true]);
  });
});
