// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Environment, Said } from "../../src/api/types";
import { captions } from "../../src/views/captions";
import { notifications } from "../../src/views/notifications";
import { peoplePanel } from "../../src/views/peoplePanel";
import { environmentPicker } from "../../src/views/environmentPicker";
import { screenView } from "../../src/views/screenView";
import { waitingNote } from "../../src/views/waitingNote";
import { json, member } from "../fakes";
import { BO, HOST, find, inside, press } from "./inside";
import { eventually } from "../waiting";

beforeEach(() => {
  document.body.innerHTML = '<div id="announcer"></div>';
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("the environment picker", () => {
  const PLACES: Environment[] = [
    { name: "studio", title: "Studio", picture_url: null, light: null },
    { name: "park", title: "Park", picture_url: "/park.jpg", light: null },
  ];

  async function choice(choose: () => Response = () => json(PLACES[1])) {
    const there = inside((call) => (call.method === "GET" ? json({ items: PLACES }) : choose()));
    const complain = vi.fn();
    const panel = environmentPicker(there.api, there.session, complain);
    document.body.append(panel.element);
    there.session.subscribe(panel.update);
    await eventually(() => find(panel.element, "environment-park"));
    const chosen = (): string | undefined =>
      [...panel.element.querySelectorAll<HTMLInputElement>("input[type=radio]")].find(({ checked }) => checked)?.value;
    return { ...there, ...panel, complain, chosen, set: find<HTMLFieldSetElement>(panel.element, "environments") };
  }

  it("asks the server with the seat's token, and shows what all are told", async () => {
    const { element, calls, roster, chosen, set } = await choice();
    expect(chosen()).toBe("studio");
    press(element, "environment-park");
    expect(set.disabled).toBe(true);
    await eventually(() => expect(set.disabled).toBe(false));
    expect(calls.at(-1)).toMatchObject({ method: "PUT", path: "/v1/meetings/m/environment", token: "Bearer seat" });
    expect(chosen()).toBe("studio"); // until the server says that it is so
    roster({ environment: "park" });
    expect(chosen()).toBe("park");
  });

  it("says why it could not be, and goes back to the place that is", async () => {
    const { element, complain, chosen } = await choice(() => json({ title: "Not now", detail: "Try later." }, 409));
    press(element, "environment-park");
    await eventually(() => expect(complain).toHaveBeenCalledWith("Not now. Try later."));
    expect(chosen()).toBe("studio");
  });

  it("is the host's; the others read where they are", async () => {
    const { element, roster, set } = await choice();
    expect(set.hidden).toBe(false);
    roster({ environment: "park", members: [member({ id: "me" }), member({ id: "b", role: "host" })] });
    expect(set.hidden).toBe(true);
    expect(element.textContent).toContain("Environment: Park. Only the host can change it.");
  });

  it("takes a picture from this device", async () => {
    const { element, calls, roster } = await choice();
    const box = find<HTMLInputElement>(element, "environment-file");
    const file = new File(["jpeg"], "garden.jpg", { type: "image/jpeg" });
    Object.defineProperty(box, "files", { value: [file] });
    box.dispatchEvent(new Event("change"));
    await eventually(() => expect(calls.at(-1)).toMatchObject({ method: "PUT", path: "/v1/meetings/m/panorama" }));
    roster({ environment: "own-1" });
    expect(box.closest("label")?.classList.contains("chosen-environment")).toBe(true);
  });
});

describe("the lobby's switch", () => {
  function panel() {
    vi.useFakeTimers();
    const there = inside();
    const { element, update } = peoplePanel(there.session);
    document.body.append(element);
    there.session.subscribe(update);
    return { ...there, box: find<HTMLInputElement>(element, "lobby") };
  }

  it("stands as it was set while the server still tells of others", () => {
    const { box, sent, roster } = panel();
    box.click();
    expect(sent).toContainEqual({ type: "lobby", on: true });
    roster({ members: [HOST] }); // sent before the wish came
    expect(box.checked).toBe(true);
    roster({ lobby: true });
    vi.advanceTimersByTime(3000);
    expect(box.checked).toBe(true);
  });

  it("goes back where the server does not do it", () => {
    const { box } = panel();
    box.click();
    vi.advanceTimersByTime(3000);
    expect(box.checked).toBe(false);
  });
});

describe("captions", () => {
  function shown() {
    vi.useFakeTimers();
    const there = inside();
    const view = captions(there.session, vi.fn());
    document.body.append(view.line, view.element);
    there.session.subscribe(view.update);
    let number = 0;
    const speak = (text: string): void =>
      there.hear({ type: "captioned", number: ++number, participant_id: "b", name: "Bo", text });
    return { ...there, ...view, speak };
  }

  it("are read by who wants them, and gone after some seconds", () => {
    const { element, line, speak } = shown();
    speak("Nobody asked for this");
    expect(line.hidden).toBe(true);
    press(element, "captions-show");
    speak("Good morning");
    expect([line.hidden, line.textContent]).toEqual([false, "Bo Good morning"]);
    vi.advanceTimersByTime(5000);
    speak("<b>all</b>");
    vi.advanceTimersByTime(5000);
    expect([line.hidden, line.textContent]).toEqual([false, "Bo <b>all</b>"]); // each has its own time
    vi.advanceTimersByTime(1000);
    expect(line.hidden).toBe(true);
  });

  it("go at once when they are switched off, and are not shown again by other news", () => {
    const { element, line, speak, roster } = shown();
    press(element, "captions-show");
    speak("Good morning");
    press(element, "captions-show");
    expect(line.hidden).toBe(true);
    press(element, "captions-show");
    roster({ environment: "park" });
    expect(line.hidden).toBe(true);
  });

  it("are written of oneself while the microphone is on, where the browser can", () => {
    const heard: EventTarget[] = [];
    class Recognition extends EventTarget {
      continuous = false;
      lang = "";
      start(): void {
        heard.push(this);
      }
      abort(): void {
        heard.pop();
      }
    }
    expect(find<HTMLElement>(shown().element, "captions-own").parentElement?.hidden).toBe(true);
    vi.stubGlobal("SpeechRecognition", Recognition);
    const { element, roster, sent, close } = shown();
    press(element, "captions-own");
    expect(heard).toHaveLength(1);
    const results = [Object.assign([{ transcript: "I am Ada" }], { isFinal: true })];
    heard[0]?.dispatchEvent(Object.assign(new Event("result"), { resultIndex: 0, results }));
    expect(sent).toEqual([{ type: "caption", text: "I am Ada" }]);
    roster({ members: [{ ...HOST, microphone: false }] });
    expect(heard).toHaveLength(0);
    roster({});
    expect(heard).toHaveLength(1);
    close();
    expect(heard).toHaveLength(0);
  });
});

describe("notifications", () => {
  it("keep a complaint for its time, whatever else is told; what was read in the chat goes at once", () => {
    vi.useFakeTimers();
    const { session, roster } = inside();
    const notes = notifications(session);
    const texts = (): (string | null)[] =>
      [...notes.element.querySelectorAll(".previews > *")].map(({ textContent }) => textContent);
    let unread: Said[] = [];
    session.subscribe(() => notes.update(unread, true));
    notes.showError("The microphone is blocked.");
    unread = [{ type: "said", number: 1, participant_id: "b", name: "Bo", text: "Hello", at: "2026-01-01T00:00:00Z" }];
    roster({});
    expect(texts()).toEqual(["The microphone is blocked.", "Bo Hello"]);
    unread = [];
    roster({ environment: "park" });
    expect(texts()).toEqual(["The microphone is blocked."]);
    vi.advanceTimersByTime(6000);
    expect(texts()).toEqual([]);
    notes.close();
  });

  it("tell a mere loss so that the picture's own words can take its place, but always how long to wait", () => {
    const { session, state } = inside();
    const notes = notifications(session);
    session.subscribe(() => notes.update([], true));
    const lost = find<HTMLElement>(notes.element, "connection-lost");
    state({ kind: "lost" });
    expect([lost.hidden, lost.classList.contains("merely-lost")]).toEqual([false, true]);
    state({ kind: "lost", waitS: 20 });
    expect([lost.hidden, lost.classList.contains("merely-lost")]).toEqual([false, false]);
    notes.close();
  });
});

describe("a shared screen", () => {
  function stage() {
    const there = inside();
    const complain = vi.fn();
    const view = screenView(there.session, complain);
    document.body.append(view.toggle, view.panel, view.knock);
    const onShown = vi.fn();
    view.onShown = onShown;
    there.session.subscribe(view.update);
    const stream = new MediaStream();
    const words = (): string => view.panel.querySelector("figcaption span")?.textContent ?? "";
    return { ...there, ...view, complain, onShown, stream, words };
  }

  it("of somebody takes the viewport while they present, and leaves it", () => {
    const { panel, show, stream, roster, words, onShown } = stage();
    show(stream);
    expect(panel.hidden).toBe(true); // a track that nobody fills
    roster({ presenter_id: "b" });
    expect([panel.hidden, words()]).toEqual([false, "Bo’s screen"]);
    const video = find<HTMLVideoElement>(panel, "screen-video");
    expect(video.srcObject).toBe(stream);
    expect(onShown).toHaveBeenLastCalledWith(video);
    expect(document.getElementById("announcer")?.textContent).toBe("Bo’s screen is shared");
    press(panel, "screen-size");
    expect(panel.classList.contains("large")).toBe(true);
    roster({ presenter_id: null });
    expect(panel.hidden).toBe(true);
    expect(video.srcObject).toBeNull();
    expect(onShown).toHaveBeenLastCalledWith(null);
  });

  it("is stopped by the host, and by nobody else who looks on", () => {
    const { panel, show, stream, roster, sent } = stage();
    show(stream);
    roster({ presenter_id: "b" });
    press(panel, "screen-stop");
    expect(sent).toEqual([{ type: "let-present", participant_id: "b", on: false }]);
    roster({ presenter_id: "b", members: [member({ id: "me" }), BO] });
    expect(find<HTMLElement>(panel, "screen-stop").hidden).toBe(true);
  });

  it("is asked of the host where somebody shares already", () => {
    const { knock, roster, sent } = stage();
    expect(knock.hidden).toBe(true);
    roster({ presenter_id: "me", presenter_asks_id: "b" });
    expect([knock.hidden, knock.querySelector("p")?.textContent]).toEqual([false, "Bo asks to share a screen"]);
    press(knock, "present-allow");
    press(knock, "present-deny");
    expect(sent).toEqual([true, false].map((on) => ({ type: "let-present", participant_id: "b", on })));
    roster({ presenter_id: "b" });
    expect(knock.hidden).toBe(true);
  });

  it("of one's own is shown while one presents, and let go when the host gives it to another", async () => {
    const track = Object.assign(new EventTarget(), { kind: "video", contentHint: "", stop: vi.fn() });
    const own = Object.assign(new MediaStream(), { getTracks: () => [track], getVideoTracks: () => [track] });
    vi.stubGlobal("navigator", { mediaDevices: { getDisplayMedia: async () => own } });
    vi.stubGlobal("RTCPeerConnection", class extends EventTarget {
      iceGatheringState = "complete";
      connectionState = "connected";
      localDescription = { sdp: "offer" };
      addTransceiver = (): undefined => undefined;
      createOffer = async () => ({});
      setLocalDescription = async () => undefined;
      setRemoteDescription = async () => undefined;
      close = (): undefined => undefined;
    });
    const asked = vi.fn(async () => new Response("answer", { status: 201 }));
    vi.stubGlobal("fetch", asked);
    const { toggle, panel, show, stream, roster, sent, words, complain } = stage();
    show(stream);
    toggle.click();
    await eventually(() => expect(sent).toEqual([{ type: "present", on: true }]));
    expect(panel.hidden).toBe(true); // not before the server says so
    roster({ presenter_id: "me" });
    expect([panel.hidden, words()]).toEqual([false, "Your screen"]);
    expect(find<HTMLVideoElement>(panel, "screen-video").srcObject).toBe(own);
    expect(toggle.getAttribute("aria-pressed")).toBe("true");
    await eventually(() => expect(asked).toHaveBeenCalledWith(expect.stringMatching(/\/whip\/m$/), expect.objectContaining({ method: "POST" })));
    roster({ presenter_id: "b" });
    expect(track.stop).toHaveBeenCalled();
    expect(complain).toHaveBeenCalledWith("Your screen is no longer shared.");
    expect([words(), toggle.getAttribute("aria-pressed")]).toEqual(["Bo’s screen", "false"]);
  });
});

describe("waitingNote", () => {
  it("is told of in plain words, aloud too, and that one still hears the others", () => {
    const note = waitingNote({ kind: "audio-only" }, true);
    expect(note.querySelector("strong")?.textContent).toBe(
      "Your connection is too slow for video. You can still hear everybody.",
    );
    expect(document.getElementById("announcer")?.textContent).toBe(note.querySelector("strong")?.textContent);
    expect(note.querySelector(".spinner")).toBeNull(); // nothing is waited for
  });

  it("promises nobody's voice to whoever is not in the meeting yet", () => {
    expect(waitingNote({ kind: "audio-only" }, false).textContent).not.toContain("hear");
  });
});
