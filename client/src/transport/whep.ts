/**
 * One rendered view by WebRTC: video down, viewpoints up (WHEP with a data channel `view`), and poses
 * down (`pose`) in place of the video while the page draws by itself, with others' pictures of themselves (`look`). A
 * second video section, empty until `setLookTrack`, has a place for small pictures of oneself.
 *
 * A connection that fails is replaced by a new one, after a growing pause, until `close`.
 */

import { NO_SERVER, Problem, asProblem, problemOf } from "../api/problem";
import type { KeepFrames, Seat } from "../api/types";
import { iceGathered, sleep } from "../api/until";
import { BATCHES, posesIn } from "./packets";

export type WhepState =
  | { kind: "connecting" }
  | { kind: "live" }
  | { kind: "reconnecting"; problem: Problem | null }
  | { kind: "refused"; problem: Problem };

export interface WhepHooks {
  /** Poses alone are wanted and sent: in a sealed meeting the server has no pictures, nor takes any. */
  readonly dataOnly: boolean;
  /** A seat in the meeting; asked for each session, and with `stale` when it is no longer accepted. */
  seat(stale: boolean): Promise<Seat>;
  /** Where a session is asked for; `lost`: the last one was lost, or did not come about. */
  address(lost: boolean): Promise<string>;
  onState(state: WhepState): void;
  onStream(stream: MediaStream): void;
  /** A packet of the channel `pose`. */
  onPose(packet: ArrayBuffer): void;
  /** A packet of the channel `look`. */
  onLook(packet: ArrayBuffer): void;
}

export interface WhepStats {
  framesDecoded: number;
  roundTripMs: number | null;
  /** Of the pictures' packets on this connection, those that came and those that did not. */
  received: number;
  lost: number;
}

const GATHERING_MS = 1500;
const CONNECTING_MS = 12_000;
const DISCONNECTED_MS = 2500;

/** Pictures of oneself leave as few bits as they can, and give way to all else. */
const LOOK_ENCODING: RTCRtpEncodingParameters = {
  maxBitrate: 225_000,
  maxFramerate: 15,
  priority: "very-low",
  networkPriority: "very-low",
};

/** The pause before attempt `attempt` (from 0): doubling, at most 8 s, spread so that not all come at once. */
export function backoffMs(attempt: number, random: number): number {
  return Math.min(8000, 500 * 2 ** attempt) * (0.75 + 0.5 * random);
}

export class WhepConnection {
  private readonly closing = new AbortController();
  private seat: Seat | null = null;
  private stale = false;
  private lost = false;
  private peer: RTCPeerConnection | null = null;
  private channel: RTCDataChannel | null = null;
  private lookSender: RTCRtpSender | null = null;
  private lookTrack: MediaStreamTrack | null = null;
  private resource: string | null = null;
  private endConnection: (() => void) | null = null;
  private skipDelay: () => void = () => undefined;
  private decodedBefore = 0;
  private decodedNow = 0;

  constructor(
    private readonly hooks: WhepHooks,
    private readonly request: typeof fetch = (input, init) => fetch(input, init),
    private readonly makePeer: (configuration: RTCConfiguration) => RTCPeerConnection = (c) =>
      new RTCPeerConnection(c),
  ) {}

  /** Connect and stay connected; returns when closed or refused. */
  async run(): Promise<void> {
    this.hooks.onState({ kind: "connecting" });
    let refusals = 0;
    for (let attempt = 0; !this.closing.signal.aborted; attempt++) {
      let problem: Problem | null = null;
      try {
        await this.connect();
        attempt = refusals = 0;
        this.hooks.onState({ kind: "live" });
        await this.connectionLost();
      } catch (error) {
        problem = asProblem(error);
      }
      const released = this.disconnect();
      this.lost = true;
      if (this.closing.signal.aborted) return;
      const refused = problem !== null && [401, 403].includes(problem.status) && refusals++ === 0;
      this.stale = released || refused;
      if (refused) this.seat = null;
      else if (problem && isFinal(problem)) {
        this.hooks.onState({ kind: "refused", problem });
        return;
      }
      this.hooks.onState({ kind: "reconnecting", problem });
      const asked = (problem?.retryAfterS ?? 0) * 1000;
      const pause = Math.max(asked, backoffMs(attempt, Math.random()));
      const over = sleep(pause, this.closing.signal).catch(() => undefined);
      const skipped = new Promise<void>((resolve) => (this.skipDelay = resolve));
      await (asked > 0 ? over : Promise.race([over, skipped]));
    }
  }

  /** Send a packet if the channel is open and not clogged; an old viewpoint is worth nothing. */
  send(packet: ArrayBuffer): boolean {
    const channel = this.channel;
    if (channel?.readyState !== "open" || channel.bufferedAmount > 4 * packet.byteLength) return false;
    channel.send(packet);
    return true;
  }

  /** A channel that moves a performer of ours; null while there is no connection. */
  openMotionChannel(performerId: string): RTCDataChannel | null {
    if (this.peer?.connectionState !== "connected") return null;
    const newest = { ordered: false, maxRetransmits: 0, protocol: performerId };
    return this.peer.createDataChannel("motion", newest);
  }

  /** Send pictures of oneself, over each connection from now on; null: none. */
  setLookTrack(track: MediaStreamTrack | null): void {
    this.lookTrack = track;
    // a connection that has ended takes none; the next one will
    this.lookSender?.replaceTrack(track).catch(() => undefined);
  }

  /** Ask about the pictures of oneself that are kept of this connection. Throws Problem. */
  async keptFrames(method: "PUT" | "POST" | "DELETE", body?: KeepFrames): Promise<unknown> {
    if (this.resource === null || this.seat === null) throw NO_SERVER;
    const headers = { Authorization: `Bearer ${this.seat.token}`, "Content-Type": "application/json" };
    const response = await this.request(`${this.resource}/kept-frames`, { method, headers, body: body ? JSON.stringify(body) : null }).catch(() => {
      throw NO_SERVER;
    });
    const text = await response.text();
    if (!response.ok) throw problemOf(response.status, text, response.headers.get("Retry-After"));
    return text === "" ? null : JSON.parse(text);
  }

  /** The server is there again: the next attempt need not wait, unless the server asked for that. */
  retryNow(): void {
    this.skipDelay();
  }

  /** The pictures have stopped although the connection stands: make a new one. */
  reconnect(): void {
    this.endConnection?.();
  }

  async stats(): Promise<WhepStats> {
    let roundTripMs: number | null = null;
    let [received, lost] = [0, 0];
    const report = await this.peer?.getStats().catch(() => null);
    report?.forEach((entry: Record<string, unknown>) => {
      if (entry["type"] === "inbound-rtp" && entry["kind"] === "video") {
        this.decodedNow = Number(entry["framesDecoded"] ?? 0);
        received = Number(entry["packetsReceived"] ?? 0);
        lost = Number(entry["packetsLost"] ?? 0);
      }
      if (entry["type"] === "candidate-pair" && entry["nominated"] === true) {
        const seconds = entry["currentRoundTripTime"];
        if (typeof seconds === "number") roundTripMs = seconds * 1000;
      }
    });
    return { framesDecoded: this.decodedBefore + this.decodedNow, roundTripMs, received, lost };
  }

  /** Leave; works while the page goes away, too. */
  close(): void {
    if (this.closing.signal.aborted) return;
    this.closing.abort();
    this.endConnection?.();
    this.disconnect();
  }

  private async connect(): Promise<void> {
    const seat = (this.seat ??= await this.hooks.seat(this.stale));
    const address = await this.hooks.address(this.lost);
    this.closing.signal.throwIfAborted();
    const peer = this.makePeer({ iceServers: seat.ice_servers, bundlePolicy: "max-bundle" });
    this.peer = peer;
    // before the offer, so that the channel is part of it
    this.channel = peer.createDataChannel("view", { ordered: false, maxRetransmits: 0 });
    const poses = peer.createDataChannel("pose", { ordered: false, maxRetransmits: 0, protocol: BATCHES });
    poses.binaryType = "arraybuffer";
    poses.addEventListener("message", ({ data }) => posesIn(data as ArrayBuffer).forEach((one) => this.hooks.onPose(one)));
    if (!this.hooks.dataOnly) await this.addPictures(peer);
    peer.addEventListener("track", (event) => {
      this.hooks.onStream(event.streams[0] ?? new MediaStream([event.track]));
    });
    const connected = whenConnected(peer, this.closing.signal);
    // the failure is awaited below; until then it must not count as unhandled
    connected.catch(() => undefined);
    await peer.setLocalDescription(await peer.createOffer());
    await iceGathered(peer, GATHERING_MS);
    const sdp = await this.exchange(address, seat, peer.localDescription?.sdp ?? "");
    await peer.setRemoteDescription({ type: "answer", sdp });
    await connected;
  }

  private async addPictures(peer: RTCPeerConnection): Promise<void> {
    this.openLooks(peer);
    const { receiver } = peer.addTransceiver("video", { direction: "recvonly" });
    // show each picture as it comes: nobody is talking in it that it would have to wait for
    if ("jitterBufferTarget" in receiver) receiver.jitterBufferTarget = 0;
    await this.reserveLook(peer);
  }

  /** Others' pictures of themselves, where this browser decodes for pages: on those that come encrypted, or from this device. */
  private openLooks(peer: RTCPeerConnection): void {
    if (typeof VideoDecoder === "undefined") return;
    const looks = peer.createDataChannel("look");
    looks.binaryType = "arraybuffer";
    looks.addEventListener("message", ({ data }) => this.hooks.onLook(data as ArrayBuffer));
  }

  private async reserveLook(peer: RTCPeerConnection): Promise<void> {
    const { sender } = peer.addTransceiver("video", { direction: "sendonly", sendEncodings: [LOOK_ENCODING] });
    this.lookSender = sender;
    // the code in the picture is legible at its full size only
    await sender.setParameters({ ...sender.getParameters(), degradationPreference: "maintain-resolution" });
    await sender.replaceTrack(this.lookTrack);
  }

  private async exchange(address: string, seat: Seat, offer: string): Promise<string> {
    const headers = { Authorization: `Bearer ${seat.token}`, "Content-Type": "application/sdp" };
    const { signal } = this.closing;
    // a browser would follow elsewhere without the token; the next attempt asks where to go
    const init: RequestInit = { method: "POST", headers, body: offer, signal, redirect: "error" };
    const response = await this.request(address, init).catch(() => {
      throw NO_SERVER;
    });
    const body = await response.text();
    if (!response.ok) {
      throw problemOf(response.status, body, response.headers.get("Retry-After"));
    }
    const location = response.headers.get("Location");
    this.resource = location && new URL(location, address).href;
    return body;
  }

  /** Resolves when the standing connection is lost, or cut by hand. */
  private connectionLost(): Promise<void> {
    const peer = this.peer;
    return new Promise((resolve) => {
      let timer: ReturnType<typeof setTimeout> | undefined;
      this.endConnection = resolve;
      const look = (): void => {
        clearTimeout(timer);
        const state = peer?.connectionState;
        if (state === "failed" || state === "closed") resolve();
        else if (state === "disconnected") timer = setTimeout(resolve, DISCONNECTED_MS);
      };
      peer?.addEventListener("connectionstatechange", look);
      // a server that ends the session closes the channel long before the network notices
      this.channel?.addEventListener("close", () => resolve());
      look();
    });
  }

  /** Whether our seat was given back with the session. */
  private disconnect(): boolean {
    this.decodedBefore += this.decodedNow;
    this.decodedNow = 0;
    // goodbye before the connection ends: a server that sees it end forgets the session by itself
    const released = this.resource !== null && this.seat !== null;
    if (this.resource && this.seat) {
      const headers = { Authorization: `Bearer ${this.seat.token}` };
      const deleted = this.request(this.resource, { method: "DELETE", headers, keepalive: true });
      deleted.catch(() => undefined);
      // a seat is given back with its session: the next connection takes one of its own
      this.seat = null;
    }
    this.peer?.close();
    this.peer = this.channel = this.lookSender = this.resource = this.endConnection = null;
    return released;
  }
}

/** Not worth another attempt: the meeting is gone, or we are not let in. */
function isFinal(problem: Problem): boolean {
  return problem.status >= 400 && problem.status < 500 && ![408, 409, 429].includes(problem.status);
}

function whenConnected(peer: RTCPeerConnection, signal: AbortSignal): Promise<void> {
  const blocked = new Problem(
    "The picture can't get through",
    "Your network may block video connections; try another network.",
  );
  return new Promise((resolve, reject) => {
    const done = new AbortController();
    const finish = (end: () => void): void => {
      clearTimeout(timer);
      done.abort();
      end();
    };
    const timer = setTimeout(() => finish(() => reject(blocked)), CONNECTING_MS);
    const look = (): void => {
      if (peer.connectionState === "connected") finish(resolve);
      else if (peer.connectionState === "failed") finish(() => reject(blocked));
    };
    peer.addEventListener("connectionstatechange", look, { signal: done.signal });
    const left = (): void => finish(() => reject(signal.reason as unknown));
    signal.addEventListener("abort", left, { signal: done.signal });
  });
}
