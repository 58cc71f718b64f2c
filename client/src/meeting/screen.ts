/**
 * One's own screen: chosen in the browser, sent by WHIP while the control channel says that we
 * present, and stopped by either side.
 */

import { Problem, problemOf } from "../api/problem";
import { iceGathered, waitFor } from "../api/until";

const CONNECTING_MS = 10_000;
const GATHERING_MS = 1000;
/** Text must stay sharp; motion may stutter. */
const SCREEN: DisplayMediaStreamOptions = { video: { frameRate: { ideal: 15, max: 30 } }, audio: false };
const NO_SHARING = new Problem("This browser can’t share a screen", "Use a browser on a computer.");
const NOT_SENT = new Problem("Your screen could not be sent", "Check your network, and share it again.");

export class ScreenShare {
  private readonly closing = new AbortController();
  private peer: RTCPeerConnection | null = null;
  private resource: string | null = null;

  private constructor(
    private readonly address: () => Promise<string>,
    private readonly token: () => Promise<string>,
    readonly stream: MediaStream,
    private readonly request: typeof fetch,
    private readonly makePeer: () => RTCPeerConnection,
  ) {}

  static isSupported(): boolean {
    return typeof globalThis.navigator?.mediaDevices?.getDisplayMedia === "function";
  }

  /** Ask for a screen; null where the viewer thought better of it. Throws a Problem. */
  static async choose(
    address: () => Promise<string>,
    token: () => Promise<string>,
    request: typeof fetch = (input, init) => fetch(input, init),
    makePeer: () => RTCPeerConnection = () => new RTCPeerConnection({ bundlePolicy: "max-bundle" }),
  ): Promise<ScreenShare | null> {
    if (!ScreenShare.isSupported()) throw NO_SHARING;
    try {
      const stream = await navigator.mediaDevices.getDisplayMedia(SCREEN);
      for (const track of stream.getVideoTracks()) track.contentHint = "detail";
      return new ScreenShare(address, token, stream, request, makePeer);
    } catch (error) {
      if (error instanceof Error && error.name === "NotAllowedError") return null;
      throw NO_SHARING;
    }
  }

  /** `onEnd` hears of it when the browser's own button ends the sharing. */
  watch(onEnd: () => void): void {
    this.stream.getVideoTracks()[0]?.addEventListener("ended", onEnd);
  }

  /** Send the screen. Throws a Problem. */
  async send(): Promise<void> {
    const [track] = this.stream.getVideoTracks();
    if (!track || this.peer) return;
    const peer = this.makePeer();
    this.peer = peer;
    peer.addTransceiver(track, { direction: "sendonly", streams: [this.stream] });
    await peer.setLocalDescription(await peer.createOffer());
    await iceGathered(peer, GATHERING_MS);
    const headers = { Authorization: `Bearer ${await this.token()}`, "Content-Type": "application/sdp" };
    const body = peer.localDescription?.sdp ?? "";
    const { signal } = this.closing;
    // who was stopped meanwhile asks for nothing that nobody would end
    signal.throwIfAborted();
    const address = await this.address();
    const init: RequestInit = { method: "POST", headers, body, signal, redirect: "error" };
    const response = await this.request(address, init).catch(() => {
      throw NOT_SENT;
    });
    const sdp = await response.text();
    if (!response.ok) throw problemOf(response.status, sdp, response.headers.get("Retry-After"));
    const location = response.headers.get("Location");
    this.resource = location && new URL(location, address).href;
    await peer.setRemoteDescription({ type: "answer", sdp });
    await waitFor(peer, "connectionstatechange", () => peer.connectionState === "connected", CONNECTING_MS);
    if (peer.connectionState !== "connected") throw NOT_SENT;
  }

  close(): void {
    this.closing.abort();
    for (const track of this.stream.getTracks()) track.stop();
    this.peer?.close();
    const { resource } = this;
    this.resource = null;
    if (resource === null) return;
    const deleteResource = async (): Promise<void> => {
      const headers = { Authorization: `Bearer ${await this.token()}` };
      await this.request(resource, { method: "DELETE", headers, keepalive: true });
    };
    deleteResource().catch(() => undefined);
  }
}
