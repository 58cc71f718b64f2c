/**
 * Voices: one's own microphone up, everybody else's down, by a connection that comes back by itself.
 *
 * The microphone is asked for when it is switched on first; until then we only listen. It is off
 * unless the server says that it is on, whoever switched it: we or the host.
 */

import { sleep } from "../api";
import { Problem, problemOf } from "../problem";
import { pauseMs } from "./line";

export interface VoiceHooks {
  /** The token of the seat that we talk from. */
  token(): Promise<string>;
  /** The others, to be played. */
  onOthers(stream: MediaStream): void;
}

const CONNECTING_MS = 10_000;
const GATHERING_MS = 1000;
const DISCONNECTED_MS = 2500;
const MICROPHONE: MediaStreamConstraints = {
  audio: { echoCancellation: true, noiseSuppression: true, autoGainControl: true },
};
const NO_MICROPHONE = new Problem(
  "Your microphone can’t be used",
  "Allow this page to use it, in the address bar or the settings of your browser, and try again.",
);

export class VoiceLink {
  private readonly closing = new AbortController();
  private peer: RTCPeerConnection | null = null;
  private sender: RTCRtpSender | null = null;
  private microphone: MediaStreamTrack | null = null;
  private place: string | null = null;

  constructor(
    private readonly address: string,
    private readonly iceServers: readonly string[],
    private readonly hooks: VoiceHooks,
    private readonly request: typeof fetch = (input, init) => fetch(input, init),
    private readonly makePeer: (configuration: RTCConfiguration) => RTCPeerConnection = (c) =>
      new RTCPeerConnection(c),
  ) {}

  /** Connect and stay connected, until closed or refused. */
  async run(): Promise<void> {
    const { signal } = this.closing;
    for (let attempt = 0; !signal.aborted; attempt++) {
      try {
        await this.connect();
        attempt = -1;
        await this.lost();
      } catch (error) {
        // who is not let in has nothing to hear; the line says why
        if (error instanceof Problem && [403, 404, 410].includes(error.status)) return this.drop();
      }
      this.drop();
      await sleep(pauseMs(attempt, Math.random()), signal).catch(() => undefined);
    }
  }

  /** Have the microphone ready. Throws a Problem where there is none, or it is not allowed. */
  async prepare(): Promise<void> {
    if (this.microphone?.readyState === "live") return;
    try {
      const stream = await navigator.mediaDevices.getUserMedia(MICROPHONE);
      this.microphone = stream.getAudioTracks()[0] ?? null;
    } catch {
      throw NO_MICROPHONE;
    }
    if (!this.microphone) throw NO_MICROPHONE;
    this.microphone.enabled = false;
    await this.sender?.replaceTrack(this.microphone);
  }

  /** Let what the microphone takes in be sent, or nothing. */
  open(on: boolean): void {
    if (this.microphone) this.microphone.enabled = on;
  }

  close(): void {
    this.closing.abort();
    this.drop();
    this.microphone?.stop();
  }

  private async connect(): Promise<void> {
    const peer = this.makePeer({ iceServers: this.iceServers.map((urls) => ({ urls })) });
    this.peer = peer;
    const transceiver = peer.addTransceiver("audio", { direction: "sendrecv" });
    this.sender = transceiver.sender;
    if (this.microphone) await this.sender.replaceTrack(this.microphone);
    peer.addEventListener("track", ({ track }) => this.hooks.onOthers(new MediaStream([track])));
    await peer.setLocalDescription(await peer.createOffer());
    await reached(peer, "icegatheringstatechange", () => peer.iceGatheringState === "complete", GATHERING_MS);
    const sdp = await this.exchange(peer.localDescription?.sdp ?? "");
    await peer.setRemoteDescription({ type: "answer", sdp });
    const connected = (): boolean => peer.connectionState === "connected";
    await reached(peer, "connectionstatechange", connected, CONNECTING_MS);
    if (!connected()) throw new Error("no connection");
  }

  private async exchange(offer: string): Promise<string> {
    const headers = { Authorization: `Bearer ${await this.hooks.token()}`, "Content-Type": "application/sdp" };
    const { signal } = this.closing;
    const response = await this.request(this.address, { method: "POST", headers, body: offer, signal });
    const body = await response.text();
    if (!response.ok) throw problemOf(response.status, body, response.headers.get("Retry-After"));
    this.place = response.headers.get("Location");
    return body;
  }

  private async lost(): Promise<void> {
    const { peer } = this;
    if (!peer) return;
    for (;;) {
      await changed(peer, this.closing.signal);
      if (peer.connectionState === "disconnected") await sleep(DISCONNECTED_MS, this.closing.signal);
      if (peer.connectionState !== "connected") return;
    }
  }

  private drop(): void {
    const { place } = this;
    this.peer?.close();
    this.peer = this.sender = this.place = null;
    if (place === null) return;
    const goodbye = async (): Promise<void> => {
      const headers = { Authorization: `Bearer ${await this.hooks.token()}` };
      await this.request(place, { method: "DELETE", headers, keepalive: true });
    };
    goodbye().catch(() => undefined);
  }
}

/** Wait until `there` holds after events of `kind`, at most so long. */
function reached(
  target: EventTarget,
  kind: string,
  there: () => boolean,
  milliseconds: number,
): Promise<void> {
  return new Promise((resolve) => {
    const done = (): void => {
      clearTimeout(timer);
      target.removeEventListener(kind, look);
      resolve();
    };
    const look = (): void => {
      if (there()) done();
    };
    const timer = setTimeout(done, milliseconds);
    target.addEventListener(kind, look);
    look();
  });
}

function changed(peer: RTCPeerConnection, signal: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    peer.addEventListener("connectionstatechange", () => resolve(), { once: true });
    signal.addEventListener("abort", () => reject(signal.reason as unknown), { once: true });
  });
}
