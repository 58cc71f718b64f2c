// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Api } from "../../src/api/api";
import type { Job, RecordingInFull } from "../../src/api/types";
import { recordingsView } from "../../src/replay/list";
import { loadRecording, type LoadedRecording } from "../../src/replay/load";
import { replayView } from "../../src/replay/view";
import { fakeFetch, job, json, tokenStore, type Call } from "../fakes";

const RECORDING = {
  id: "r",
  meeting_id: "m",
  name: "Monday",
  asked_at: "2026-01-01T10:00:00Z",
  duration_s: 60,
  mine: true,
  members: [{ participant_id: "a", name: "Ada" }, { participant_id: "b", name: "Bo" }],
  tracks: [],
} as unknown as RecordingInFull;

function loaded(part: Partial<LoadedRecording> = {}): LoadedRecording {
  return {
    recording: RECORDING,
    rooms: { times: [], items: [] },
    motions: new Map(),
    chats: new Map([
      ["a", { times: [1000, 20_000], items: ["Hello", "Bye"] }],
      ["b", { times: [5000], items: ["Hi Ada"] }],
    ]),
    voices: new Map(),
    ...part,
  };
}

let close: () => void = () => undefined;

function setUp(answer: (call: Call) => Response = () => json({}), part: Partial<LoadedRecording> = {}) {
  const { request, calls } = fakeFetch(answer);
  const onLeave = vi.fn();
  const view = replayView(new Api(tokenStore("guest"), request), loaded(part), { onLeave });
  close = view.close;
  document.body.replaceChildren(view.element);
  const find = <Kind extends HTMLElement>(testId: string): Kind => {
    const found = view.element.querySelector<Kind>(`[data-testid="${testId}"]`);
    if (!found) throw new Error(`${testId} is not there`);
    return found;
  };
  const seek = (ms: number): void => {
    const bar = find<HTMLInputElement>("replay-seek");
    bar.value = String(ms);
    bar.dispatchEvent(new Event("input", { bubbles: true }));
  };
  const clock = (): string => find<HTMLOutputElement>("replay-clock").value;
  const chat = (): (string | null)[] => [...find("replay-chat").children].map(({ textContent }) => textContent);
  return { element: view.element, find, seek, clock, chat, calls, onLeave };
}

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("Worker", class extends EventTarget {
    postMessage = (): void => undefined;
    terminate = (): void => undefined;
  });
  const node = (): object => ({ connect: () => node(), positionX: {}, positionY: {}, positionZ: {} });
  vi.stubGlobal("AudioContext", class {
    listener = { positionX: {}, positionY: {}, positionZ: {}, forwardX: {}, forwardY: {}, forwardZ: {}, upX: {}, upY: {}, upZ: {} };
    createPanner = node;
    createMediaElementSource = node;
    close = async (): Promise<void> => undefined;
  });
});
afterEach(() => {
  close();
  vi.useRealTimers();
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

describe("replaying", () => {
  it("plays and pauses, and shows the moment", async () => {
    const { find, clock } = setUp();
    const play = find("replay-play");
    expect([clock(), play.textContent]).toEqual(["0:00 / 1:00", "Play"]);
    play.click();
    expect(play.textContent).toBe("Pause");
    await vi.advanceTimersByTimeAsync(3000);
    expect(clock()).toBe("0:03 / 1:00");
    play.click();
    await vi.advanceTimersByTimeAsync(3000);
    expect([clock(), play.textContent]).toEqual(["0:03 / 1:00", "Play"]);
  });

  it("stops at the end, and begins again from there", async () => {
    const { find, seek, clock } = setUp();
    seek(59_000);
    find("replay-play").click();
    await vi.advanceTimersByTimeAsync(2000);
    expect([clock(), find("replay-play").textContent]).toEqual(["1:00 / 1:00", "Play"]);
    find("replay-play").click();
    expect(clock()).toBe("0:00 / 1:00");
  });

  it("plays twice as fast where that is chosen", async () => {
    const { find, clock } = setUp();
    const speed = find<HTMLSelectElement>("replay-speed");
    speed.value = "2";
    speed.dispatchEvent(new Event("change"));
    find("replay-play").click();
    await vi.advanceTimersByTimeAsync(4000);
    expect(clock()).toBe("0:08 / 1:00");
  });

  it("jumps by five seconds with the arrows on the bar, which then do not walk", () => {
    const { find, clock } = setUp();
    const walked = vi.fn();
    window.addEventListener("keydown", walked, { once: true });
    const press = (key: string): void => void find("replay-seek").dispatchEvent(new KeyboardEvent("keydown", { key, code: key, bubbles: true, cancelable: true }));
    press("ArrowRight");
    press("ArrowRight");
    press("ArrowLeft");
    expect(clock()).toBe("0:05 / 1:00");
    expect(find("replay-seek").getAttribute("aria-valuetext")).toBe("0:05 / 1:00");
    press("ArrowLeft");
    press("ArrowLeft");
    expect(clock()).toBe("0:00 / 1:00");
    expect(walked).not.toHaveBeenCalled();
    window.removeEventListener("keydown", walked);
  });

  it("shows what had been written by then, by whom", () => {
    const { seek, chat } = setUp();
    expect(chat()).toEqual([]);
    seek(6000);
    expect(chat()).toEqual(["Ada Hello", "Bo Hi Ada"]);
    seek(30_000);
    expect(chat()).toEqual(["Ada Hello", "Bo Hi Ada", "Ada Bye"]);
    seek(2000);
    expect(chat()).toEqual(["Ada Hello"]);
  });

  it("says why this device can't show the room", async () => {
    const { element } = setUp();
    await vi.advanceTimersByTimeAsync(100);
    expect(element.textContent).toContain("This browser can’t render people: it has no WebGL2");
  });
});

describe("a recording's voices", () => {
  class FakeAudio {
    static made: FakeAudio[] = [];
    currentTime = 0;
    duration = 30;
    playbackRate = 1;
    paused = true;
    constructor(readonly src: string) {
      FakeAudio.made.push(this);
    }
    play = async (): Promise<void> => void (this.paused = false);
    pause = (): void => void (this.paused = true);
  }

  it("follow the player: its pauses, jumps and speed, to the end of each voice", async () => {
    FakeAudio.made = [];
    vi.stubGlobal("Audio", FakeAudio);
    const context = globalThis.AudioContext as unknown as { prototype: { resume(): Promise<void> } };
    context.prototype.resume = async () => undefined;
    const { find, seek } = setUp(undefined, { voices: new Map([["a", new Blob(["ogg"])]]) });
    const [voice] = FakeAudio.made as [FakeAudio];
    find("replay-play").click();
    expect([voice.paused, voice.currentTime]).toEqual([false, 0]);
    seek(10_000);
    expect(voice.currentTime).toBe(10);
    voice.currentTime = 10.05; // what the sound drifts by is not worth a jump
    await vi.advanceTimersByTimeAsync(200);
    expect(voice.currentTime).toBe(10.2);
    voice.currentTime = 10.39;
    await vi.advanceTimersByTimeAsync(200);
    expect(voice.currentTime).toBe(10.39);
    find("replay-play").click();
    expect(voice.paused).toBe(true);
    find("replay-play").click();
    seek(40_000);
    expect(voice.paused).toBe(true);
  });
});

describe("what one may do with a recording", () => {
  const exported = (last: Partial<Job>) => (call: Call): Response => {
    if (call.path.endsWith("/export")) return json(job({ id: "x", kind: "export", progress: 0.25 }));
    if (call.path === "/v1/jobs/x") return json(job({ id: "x", kind: "export", ...last }));
    return new Response("video");
  };

  it("is to export it as a video, which is then saved", async () => {
    const saved: string[] = [];
    vi.spyOn(HTMLAnchorElement.prototype, "click").mockImplementation(function (this: HTMLAnchorElement) {
      saved.push(this.download);
    });
    const { find, calls } = setUp(exported({ state: "succeeded" }));
    const button = find<HTMLButtonElement>("replay-export");
    button.click();
    await vi.advanceTimersByTimeAsync(500);
    expect([button.disabled, button.textContent]).toEqual([true, "Exporting, 25 %"]);
    await vi.advanceTimersByTimeAsync(1000);
    expect(saved).toEqual(["Monday.mp4"]);
    expect(calls.at(-1)?.path).toBe("/v1/recordings/r/videos/x");
    expect([button.disabled, button.textContent]).toEqual([false, "Export video"]);
  });

  it("tells in the server's words why an export failed", async () => {
    const error = { type: "urn:metanerf:no-space-left", title: "No space left", detail: "the disk is full", status: 507 };
    const { find, calls } = setUp(exported({ state: "failed", error }));
    find("replay-export").click();
    await vi.advanceTimersByTimeAsync(2000);
    expect(find("error").textContent).toContain("No space left");
    expect(find("error").textContent).toContain("The disk is full.");
    expect(calls.some(({ path }) => path.includes("videos"))).toBe(false);
    expect(find<HTMLButtonElement>("replay-export").disabled).toBe(false);
  });

  it("fetches no video of an export that was cancelled", async () => {
    const { find, calls } = setUp(exported({ state: "cancelled", message: "stopped by its owner" }));
    find("replay-export").click();
    await vi.advanceTimersByTimeAsync(2000);
    expect(find("error").textContent).toContain("Stopped by its owner.");
    expect(calls.some(({ path }) => path.includes("videos"))).toBe(false);
  });

  it("is to delete it where it is one's own, once asked", async () => {
    const { find, calls, onLeave } = setUp();
    const asked = vi.fn(() => false);
    vi.stubGlobal("confirm", asked);
    find("replay-delete").click();
    await vi.advanceTimersByTimeAsync(10);
    expect(calls).toEqual([]);
    asked.mockReturnValue(true);
    find("replay-delete").click();
    await vi.advanceTimersByTimeAsync(10);
    expect(calls).toMatchObject([{ method: "DELETE", path: "/v1/recordings/r" }]);
    expect(onLeave).toHaveBeenCalledTimes(1);
  });

  it("is to delete one's own part of another's, and stay where that is refused", async () => {
    const recording = { ...RECORDING, mine: false };
    const { find, calls, onLeave } = setUp(() => json({ title: "Not yours" }, 403), { recording });
    vi.stubGlobal("confirm", () => true);
    find("replay-mine").click();
    await vi.advanceTimersByTimeAsync(10);
    expect(calls).toMatchObject([{ method: "DELETE", path: "/v1/recordings/r/mine" }]);
    expect(find("error").textContent).toContain("Not yours");
    expect(onLeave).not.toHaveBeenCalled();
  });
});

describe("loading a recording", () => {
  const record = (data: Uint8Array): ArrayBuffer => {
    const bytes = new Uint8Array(6 + data.length);
    new DataView(bytes.buffer).setUint16(4, data.length, true);
    bytes.set(data, 6);
    return bytes.buffer;
  };
  const text = (words: string): Uint8Array => new TextEncoder().encode(words);

  it("reads each track as its kind, and voices as files", async () => {
    const room = { environment: "park", performers: [], standing_for: {} };
    const tracks = [
      { name: "room", url: "/room" },
      { name: "chat:a", url: "/chat" },
      { name: "voice:b", url: "/never" },
      { name: "motion:p", url: "/motion" },
    ];
    const files: Record<string, BodyInit> = {
      "/room": record(text(JSON.stringify(room))),
      "/chat": record(text("Hello")),
      "/motion": record(text("no pose packet")),
      "/v1/recordings/r/voices/b.ogg": "ogg",
    };
    const { request, calls } = fakeFetch(({ path }) =>
      path === "/v1/recordings/r" ? json({ ...RECORDING, tracks }) : new Response(files[path] ?? null, { status: path in files ? 200 : 404 }),
    );
    const found = await loadRecording(new Api(tokenStore("guest"), request), "r");
    expect(found.rooms.items).toEqual([room]);
    expect(found.chats.get("a")?.items).toEqual(["Hello"]);
    expect(found.motions.get("p")?.items).toEqual([]);
    expect([...found.voices.keys()]).toEqual(["b"]);
    expect(calls.map(({ path }) => path)).not.toContain("/never");
  });

  it("throws what the server says of a recording that is gone", async () => {
    const { request } = fakeFetch(() => json({ title: "No such recording" }, 404));
    await expect(loadRecording(new Api(tokenStore("guest"), request), "r")).rejects.toMatchObject({ title: "No such recording" });
  });
});

describe("the list of recordings", () => {
  it("leads to each, with its length and who is left in it", () => {
    const { element } = recordingsView([RECORDING, { ...RECORDING, id: "s", members: [] }]);
    const [first, second] = element.querySelectorAll("li");
    expect(first?.querySelector("a")?.getAttribute("href")).toBe("/?recording=r");
    expect(first?.textContent).toContain("1:00, Ada, Bo");
    expect(second?.textContent).toContain("no participants left");
  });

  it("says so where there are none", () => {
    expect(recordingsView([]).element.textContent).toContain("Nothing has been recorded yet.");
  });
});
