import { afterEach, describe, expect, it, vi } from "vitest";
import { ScreenShare } from "../../src/meeting/screen";
import { fakeFetch } from "../fakes";
import { eventually } from "../waiting";

class FakePeer extends EventTarget {
  iceGatheringState = "complete";
  connectionState = "connected";
  localDescription = { sdp: "offer" };
  closed = false;
  sent: unknown[] = [];
  addTransceiver(track: unknown): void {
    this.sent.push(track);
  }
  createOffer = async () => ({});
  setLocalDescription = async () => undefined;
  setRemoteDescription = async () => undefined;
  close(): void {
    this.closed = true;
  }
}

function track() {
  return Object.assign(new EventTarget(), { kind: "video", contentHint: "", stopped: false, stop(this: { stopped: boolean }) { this.stopped = true; } });
}

async function choose(answer: () => Response) {
  const shown = track();
  const stream = { getTracks: () => [shown], getVideoTracks: () => [shown] };
  vi.stubGlobal("navigator", { mediaDevices: { getDisplayMedia: async () => stream } });
  const peer = new FakePeer();
  const { request, calls } = fakeFetch(answer);
  const share = await ScreenShare.choose(async () => "https://one.example/whip/m", async () => "seat", request, () => peer as unknown as RTCPeerConnection);
  if (!share) throw new Error("a screen was expected");
  return { share, shown, peer, calls };
}

describe("sharing a screen", () => {
  afterEach(() => vi.unstubAllGlobals());

  it("sends it by WHIP, once, and says goodbye", async () => {
    const { share, shown, peer, calls } = await choose(
      () => new Response("answer", { status: 201, headers: { Location: "/whip/m/1" } }),
    );
    expect(shown.contentHint).toBe("detail");
    await share.send();
    await share.send();
    expect(calls.map(({ method, path }) => [method, path])).toEqual([["POST", "https://one.example/whip/m"]]);
    share.close();
    await eventually(() => expect(calls.at(-1)).toMatchObject({ method: "DELETE", path: "https://one.example/whip/m/1" }));
    expect([shown.stopped, peer.closed]).toEqual([true, true]);
  });

  it("asks for nothing once it was stopped", async () => {
    const { share, calls } = await choose(() => new Response("answer", { status: 201 }));
    const sending = share.send();
    share.close();
    await expect(sending).rejects.toThrow();
    expect(calls).toEqual([]);
  });

  it("hears of it when the browser's own button ends it", async () => {
    const { share, shown } = await choose(() => new Response(""));
    const onEnd = vi.fn();
    share.watch(onEnd);
    shown.dispatchEvent(new Event("ended"));
    expect(onEnd).toHaveBeenCalledOnce();
  });

  it("tells why the server refuses", async () => {
    const { share } = await choose(() => new Response("{}", { status: 403 }));
    await expect(share.send()).rejects.toMatchObject({ status: 403 });
  });

  it("is nothing where the viewer thinks better of it, and a problem where no browser can", async () => {
    const refuse = async (): Promise<never> => Promise.reject(new DOMException("", "NotAllowedError"));
    vi.stubGlobal("navigator", { mediaDevices: { getDisplayMedia: refuse } });
    expect(await ScreenShare.choose(async () => "https://one.example/whip/m", async () => "seat")).toBeNull();
    vi.stubGlobal("navigator", { mediaDevices: {} });
    expect(ScreenShare.isSupported()).toBe(false);
    await expect(ScreenShare.choose(async () => "https://one.example/whip/m", async () => "seat")).rejects.toMatchObject({
      title: "This browser can’t share a screen",
    });
  });
});
