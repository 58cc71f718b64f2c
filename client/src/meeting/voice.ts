/**
 * Voices: one's own microphone up, the others' down, each speaker in a track of their own, by a
 * connection that comes back by itself. `slots` says who is heard in which track; `screen` is what
 * somebody shares, worth showing while the roster names a presenter.
 *
 * The microphone is asked for when it is switched on first; until then we only listen. It is off
 * unless the server says that it is on, whoever switched it: we or the host.
 */

import { microphoneProblem, microphoneConstraints } from "../capture/devices";
import { Problem, problemOf } from "../api/problem";
import type { IceServer } from "../api/types";
import { iceGathered, waitFor, sleep } from "../api/until";
import type { VoiceSource } from "./spatialAudio";
import { reconnectDelayMs } from "./controlConnection";

export interface VoiceHooks {
  /** Where a connection is asked for; `lost`: the last one was lost, or did not come about. */
  address(lost: boolean): Promise<string>;
  /** The token of the seat that we talk from. */
  token(): Promise<string>;
  /** `slots` or `screen` has changed. */
  onChange(): void;
}

/** Tracks of voices that the server fills; more than so many rarely talk at once. */
export const SLOTS = 6;

const CONNECTING_MS = 10_000;
const GATHERING_MS = 1000;
const DISCONNECTED_MS = 2500;

export class VoiceConnection {
  /** Who is heard, by track. */
  slots: ReadonlyMap<number, VoiceSource> = new Map();
  /** The screen that somebody shares, if one comes; null without a connection. */
  screen: MediaStream | null = null;
  private streams: MediaStream[] = [];
  /** By track: s that all samples so far waited, and how many they were. */
  private buffered: Map<string, readonly [number, number]> = new Map();
  private slotHolders: readonly (string | null)[] = [];
  private readonly closing = new AbortController();
  private peer: RTCPeerConnection | null = null;
  private sender: RTCRtpSender | null = null;
  private microphone: MediaStreamTrack | null = null;
  private resource: string | null = null;
  private endConnection: () => void = () => undefined;

  constructor(
    private readonly iceServers: IceServer[],
    private readonly hooks: VoiceHooks,
    private readonly request: typeof fetch = (input, init) => fetch(input, init),
    private readonly makePeer: (configuration: RTCConfiguration) => RTCPeerConnection = (c) =>
      new RTCPeerConnection(c),
  ) {}

  /** Connect and stay connected, until closed or refused. */
  async run(): Promise<void> {
    const { signal } = this.closing;
    let lost = false;
    for (let attempt = 0; !signal.aborted; attempt++) {
      try {
        await this.connect(lost);
        attempt = -1;
        await this.connectionLost();
      } catch (error) {
        // who is not let in has nothing to hear; the control connection says why
        if (error instanceof Problem && [403, 404, 410].includes(error.status)) return this.disconnect();
      }
      this.disconnect();
      lost = true;
      await sleep(reconnectDelayMs(attempt, Math.random()), signal).catch(() => undefined);
    }
  }

  /** Have the microphone ready. Throws a Problem where there is none, or it is not allowed. */
  async acquireMicrophone(): Promise<void> {
    if (this.microphone?.readyState === "live") return;
    try {
      const stream = await navigator.mediaDevices.getUserMedia({ audio: microphoneConstraints() });
      this.microphone = stream.getAudioTracks()[0] ?? null;
    } catch (error) {
      throw microphoneProblem(error instanceof Error ? error.name : "");
    }
    if (!this.microphone) throw microphoneProblem("NotFoundError");
    this.microphone.enabled = false;
    // not awaited: it never settles where the connection is closed meanwhile; the next one takes the track itself
    this.sender?.replaceTrack(this.microphone).catch(() => undefined);
  }

  /** What the server says of who is in which track. */
  assignSlots(holders: readonly (string | null)[]): void {
    if (holders.join() === this.slotHolders.join()) return;
    this.slotHolders = holders;
    this.updateSlots();
  }

  /** Let what the microphone takes in be sent, or nothing. */
  setMicrophoneEnabled(on: boolean): void {
    if (this.microphone) this.microphone.enabled = on;
  }

  /** The meeting lives elsewhere: make a new connection. */
  reconnect(): void {
    this.endConnection();
  }

  /** `ended`: the server has ended it, or is about to. */
  close(ended = false): void {
    this.closing.abort();
    if (ended) this.resource = null;
    this.disconnect();
    this.microphone?.stop();
  }

  /** How long a voice has waited in this browser until it is played, ms, by who is heard; since the last call. */
  async bufferDelaysMs(): Promise<ReadonlyMap<string, number>> {
    const found = new Map<string, number>();
    const before = this.buffered;
    this.buffered = new Map();
    const report = await this.peer?.getStats().catch(() => null);
    report?.forEach((entry: Record<string, unknown>) => {
      if (entry["type"] !== "inbound-rtp" || entry["kind"] !== "audio") return;
      const track = String(entry["trackIdentifier"]);
      const [waitedS, samples] = [Number(entry["jitterBufferDelay"]), Number(entry["jitterBufferEmittedCount"])];
      this.buffered.set(track, [waitedS, samples]);
      const [waitedBeforeS, samplesBefore] = before.get(track) ?? [waitedS, samples];
      const memberId = [...this.slots.values()].find(({ stream }) => stream.getAudioTracks()[0]?.id === track)?.memberId;
      if (!memberId || samples <= samplesBefore) return;
      found.set(memberId, (1000 * (waitedS - waitedBeforeS)) / (samples - samplesBefore));
    });
    return found;
  }

  private async connect(lost: boolean): Promise<void> {
    const address = await this.hooks.address(lost);
    const peer = this.makePeer({ iceServers: this.iceServers, bundlePolicy: "max-bundle" });
    this.peer = peer;
    this.sender = peer.addTransceiver("audio", { direction: "sendonly" }).sender;
    if (this.microphone) await this.sender.replaceTrack(this.microphone);
    const receive = (kind: string): MediaStream =>
      new MediaStream([peer.addTransceiver(kind, { direction: "recvonly" }).receiver.track]);
    const streams = Array.from({ length: SLOTS }, () => receive("audio"));
    const screen = receive("video");
    await peer.setLocalDescription(await peer.createOffer());
    await iceGathered(peer, GATHERING_MS);
    const sdp = await this.exchange(address, peer.localDescription?.sdp ?? "");
    await peer.setRemoteDescription({ type: "answer", sdp });
    const connected = (): boolean => peer.connectionState === "connected";
    await waitFor(peer, "connectionstatechange", connected, CONNECTING_MS);
    if (!connected()) throw new Error("no connection");
    this.streams = streams;
    this.screen = screen;
    this.updateSlots();
  }

  private updateSlots(): void {
    const heard = this.streams.flatMap((stream, slot) => {
      const memberId = this.slotHolders[slot];
      return memberId ? [[slot, { memberId, stream }] as const] : [];
    });
    this.slots = new Map(heard);
    this.hooks.onChange();
  }

  private async exchange(address: string, offer: string): Promise<string> {
    const headers = { Authorization: `Bearer ${await this.hooks.token()}`, "Content-Type": "application/sdp" };
    const { signal } = this.closing;
    const response = await this.request(address, { method: "POST", headers, body: offer, signal, redirect: "error" });
    const body = await response.text();
    if (!response.ok) throw problemOf(response.status, body, response.headers.get("Retry-After"));
    const location = response.headers.get("Location");
    this.resource = location && new URL(location, address).href;
    return body;
  }

  private async connectionLost(): Promise<void> {
    const { peer } = this;
    if (!peer) return;
    const cut = new Promise<"cut">((resolve) => (this.endConnection = () => resolve("cut")));
    for (;;) {
      const what = await Promise.race([stateChanged(peer, this.closing.signal), cut]);
      if (what === "cut") return;
      if (peer.connectionState === "disconnected") await sleep(DISCONNECTED_MS, this.closing.signal);
      if (peer.connectionState !== "connected") return;
    }
  }

  private disconnect(): void {
    const { resource } = this;
    this.peer?.close();
    this.peer = this.sender = this.resource = this.screen = null;
    this.streams = [];
    this.updateSlots();
    if (resource === null) return;
    const deleteResource = async (): Promise<void> => {
      const headers = { Authorization: `Bearer ${await this.hooks.token()}` };
      await this.request(resource, { method: "DELETE", headers, keepalive: true });
    };
    deleteResource().catch(() => undefined);
  }
}

function stateChanged(peer: RTCPeerConnection, signal: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    peer.addEventListener("connectionstatechange", () => resolve(), { once: true });
    signal.addEventListener("abort", () => reject(signal.reason as unknown), { once: true });
  });
}
