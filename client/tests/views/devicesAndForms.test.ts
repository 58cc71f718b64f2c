// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Api } from "../../src/api/api";
import { Problem } from "../../src/api/problem";
import type { Performer } from "../../src/api/types";
import type { LiveView } from "../../src/drawing/live";
import type { AnimatablePerson } from "../../src/enrolment/keypoints";
import { chosenDevices } from "../../src/capture/devices";
import { deviceCheck } from "../../src/views/deviceCheck";
import { keypointsForm } from "../../src/views/keypointsForm";
import { motionCaptureView } from "../../src/views/motionCapture";
import { fakeFetch, json, tokenStore } from "../fakes";
import { performer } from "../viewpoint/front";
import { performerCheck } from "../../src/transport/packets";
import { find } from "./inside";
import { eventually } from "../waiting";

const soon = (): Promise<void> => new Promise((resolve) => setTimeout(resolve));

beforeEach(() => {
  localStorage.clear();
  document.body.innerHTML = '<div id="announcer"></div>';
  Object.defineProperty(HTMLMediaElement.prototype, "srcObject", { writable: true, value: null, configurable: true });
  HTMLVideoElement.prototype.cancelVideoFrameCallback = () => undefined;
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("the form of keypoints", () => {
  const PEOPLE: AnimatablePerson[] = [
    { personId: "a", name: "Ada", modelId: "m1", mine: true },
    { personId: "b", name: "Bo", modelId: "m2", mine: false },
  ];

  async function form(people: () => Promise<AnimatablePerson[]> = async () => PEOPLE, animate: () => Promise<void> = async () => undefined) {
    const onAnimate = vi.fn((_person: AnimatablePerson, _file: File) => animate());
    const element = keypointsForm({ listPeople: people, onAnimate });
    document.body.append(element);
    await soon();
    const choose = (): File => {
      const file = new File(["{}"], "walk.json");
      const input = find<HTMLInputElement>(element, "keypoints-file");
      Object.defineProperty(input, "files", { value: [file] });
      input.dispatchEvent(new Event("change"));
      return file;
    };
    const submit = async (): Promise<void> => {
      element.dispatchEvent(new Event("submit", { cancelable: true }));
      await soon();
    };
    const error = (): string => element.querySelector("[role=alert]")?.textContent ?? "";
    return { element, onAnimate, choose, submit, error, go: find<HTMLButtonElement>(element, "keypoints-submit") };
  }

  it("starts a meeting of whom one chooses with the file", async () => {
    const { element, onAnimate, choose, submit, error } = await form();
    await submit();
    expect([error(), onAnimate.mock.calls.length]).toEqual(["Choose a keypoints file first.", 0]);
    const file = choose();
    expect(error()).toBe("");
    find<HTMLSelectElement>(element, "keypoints-who").value = "1";
    await submit();
    expect(onAnimate).toHaveBeenCalledWith(PEOPLE[1], file);
  });

  it("takes one press at a time, and can be sent again after a failure", async () => {
    let fail: (error: unknown) => void = () => undefined;
    const { choose, submit, error, go } = await form(undefined, () => new Promise((_, reject) => (fail = reject)));
    choose();
    await submit();
    expect(go.disabled).toBe(true);
    fail(new Problem("No keypoints", "Another format."));
    await soon();
    expect([error(), go.disabled]).toEqual(["No keypoints: Another format.", false]);
  });

  it("says so where there is nobody to animate, and where the list can't be had", async () => {
    const { error, go } = await form(async () => []);
    expect([error(), go.disabled]).toEqual(["There are no models yet. Create one from a clip first.", true]);
    const lost = await form(() => Promise.reject(new Problem("The server is busy", "Wait.")));
    expect(lost.error()).toBe("The server is busy: Wait.");
  });
});

describe("trying camera and microphone", () => {
  class FakeTrack {
    stopped = false;
    constructor(readonly deviceId: string) {}
    getSettings = (): object => ({ deviceId: this.deviceId });
    stop = (): void => void (this.stopped = true);
  }

  function check(refused = "") {
    const tracks: FakeTrack[] = [];
    const getUserMedia = vi.fn(async ({ video, audio }: MediaStreamConstraints) => {
      const kind = video ? "camera" : "microphone";
      if (kind === refused) throw new DOMException("no", "NotAllowedError");
      const wanted = (video || audio) as MediaTrackConstraints;
      const { ideal } = (wanted.deviceId ?? { ideal: `${kind}1` }) as { ideal: string };
      const track = new FakeTrack(ideal);
      tracks.push(track);
      return { getTracks: () => [track], getVideoTracks: () => [track] };
    });
    const device = (kind: string, deviceId: string, label: string): object => ({ kind, deviceId, label });
    const enumerateDevices = async (): Promise<object[]> => [
      device("videoinput", "camera1", "Desk"), device("videoinput", "camera2", ""), device("audioinput", "microphone1", "Desk"),
    ];
    vi.stubGlobal("navigator", Object.assign(Object.create(navigator), { mediaDevices: { getUserMedia, enumerateDevices } }));
    vi.stubGlobal("AudioContext", class {
      createAnalyser = (): object => ({ fftSize: 4, getFloatTimeDomainData: (samples: Float32Array) => samples.fill(1) });
      createMediaStreamSource = (): object => ({ connect: () => undefined });
      close = async (): Promise<void> => undefined;
    });
    const { request } = fakeFetch(() => json({ items: [] }));
    const view = deviceCheck(new Api(tokenStore("guest"), request));
    const details = view.element as HTMLDetailsElement;
    document.body.append(details);
    const open = async (on: boolean): Promise<void> => {
      details.open = on; // which tells of itself
      await soon();
      await soon();
    };
    return { ...view, open, tracks, getUserMedia };
  }

  it("asks for nothing until it is opened, and lets go when it is closed", async () => {
    const { open, tracks, getUserMedia } = check();
    expect(getUserMedia).not.toHaveBeenCalled();
    await open(true);
    expect(tracks.map(({ deviceId }) => deviceId).sort()).toEqual(["camera1", "microphone1"]);
    await open(false);
    expect(tracks.every(({ stopped }) => stopped)).toBe(true);
  });

  it("offers the devices by name, and remembers which was chosen", async () => {
    const { element, open, tracks } = check();
    await open(true);
    const cameras = find<HTMLSelectElement>(element, "check-videoinput");
    expect([...cameras.options].map(({ textContent }) => textContent)).toEqual(["Desk", "Camera 2"]);
    expect(find<HTMLSelectElement>(element, "check-audioinput").disabled).toBe(true); // one alone is no choice
    cameras.value = "camera2";
    cameras.dispatchEvent(new Event("change"));
    await soon();
    expect(chosenDevices().camera).toBe("camera2");
    expect(tracks.at(-1)?.deviceId).toBe("camera2");
    expect(tracks.find(({ deviceId }) => deviceId === "camera1")?.stopped).toBe(true);
    await open(false);
  });

  it("shows how loud the microphone is", async () => {
    const { element, open } = check();
    await open(true);
    await eventually(() => expect(find<HTMLMeterElement>(element, "check-level").value).toBe(1));
    await open(false);
    expect(find<HTMLMeterElement>(element, "check-level").value).toBe(0);
  });

  it("says what is blocked, and shows the other one all the same", async () => {
    const { element, open } = check("camera");
    await open(true);
    expect(find(element, "problem-videoinput").textContent).toContain("The camera is blocked.");
    expect(find(element, "problem-audioinput").textContent).toBe("");
    expect(find<HTMLElement>(element, "check-audioinput").hidden).toBe(false);
    await open(false);
  });

  it("remembers whether one joins with the microphone on", () => {
    const box = find<HTMLInputElement>(check().element, "join-unmuted");
    box.checked = true;
    box.dispatchEvent(new Event("change"));
    expect(chosenDevices().joinUnmuted).toBe(true);
    expect(find<HTMLInputElement>(check().element, "join-unmuted").checked).toBe(true);
  });
});

describe("motion capture in the meeting", () => {
  /** What the server answers where it is not asked for pictures. */
  let stored: Record<string, Response> = {};
  const list = (...items: object[]): Response => json({ items });
  beforeEach(() => {
    stored = { "/v1/people": list(), "/v1/models": list() };
  });
  function view(...performers: Performer[]) {
    const getUserMedia = vi.fn(() => new Promise(() => undefined)); // the browser still asks
    vi.stubGlobal("navigator", Object.assign(Object.create(navigator), { mediaDevices: { getUserMedia } }));
    const { request, calls } = fakeFetch(({ path }) => stored[path] ?? new Response(new Blob(["picture"])));
    const watchPoses = vi.fn();
    const live = { api: new Api(tokenStore("guest"), request), meeting: { id: "m", performers }, watchPoses };
    const made = motionCaptureView(live as unknown as LiveView);
    document.body.append(made.toggle, made.element);
    const start = async (): Promise<void> => {
      made.toggle.click();
      await soon();
    };
    return { ...made, live, start, getUserMedia, calls, watchPoses };
  }
  const [demo, own] = [{ owner: "demo" }, { owner: "own" }] as const;

  it("asks nothing of whoever has one model of their own, and ends by the same press", async () => {
    const { element, toggle, start, getUserMedia } = view(performer("Ada", demo), performer("Ada", { id: "mine", ...own }), performer("Cy"));
    await start();
    expect(getUserMedia).toHaveBeenCalledTimes(1);
    expect(element.textContent).toContain("Animating Ada.");
    // there is nothing to send before the camera is on
    expect(find(element, "live-look").closest<HTMLElement>(".live-look")?.hidden).toBe(true);
    expect(toggle.getAttribute("aria-pressed")).toBe("true");
    await start();
    expect([element.textContent, toggle.getAttribute("aria-pressed")]).toEqual(["As others see you", "false"]);
  });

  it("takes the demo's model for a guest who brought none, which has no live look", async () => {
    const { element, start } = view(performer("Ada", demo), performer("Cy"));
    await start();
    expect(element.textContent).toContain("Animating Ada.");
    expect(element.querySelector("[data-testid=live-look]")).toBeNull();
  });

  it("asks which model is one's own where there are several, and shows a picture of each", async () => {
    const { element, start, getUserMedia, calls } = view(performer("Ada", own), performer("Bo"), performer("Cy", own));
    await start();
    const choices = [...find(element, "model-choices").querySelectorAll("button")];
    expect(choices.map(({ textContent }) => textContent)).toEqual(["Ada", "Cy"]);
    expect(choices.map((one) => one.querySelector("img")?.src.startsWith("blob:"))).toEqual([true, true]);
    expect(calls.map(({ path }) => path)).toEqual(["/v1/models/m-Ada/views", "/v1/models/m-Cy/views"]);
    expect(getUserMedia).not.toHaveBeenCalled();
    choices[1]?.click();
    expect(element.textContent).toContain("Animating Cy.");
  });

  it("shows oneself as the others see one: from poses, until it is switched off", async () => {
    const { element, start, calls, watchPoses, close } = view(performer("Ada", own), performer("Cy"));
    await start();
    const onPose = watchPoses.mock.lastCall?.[0] as (pose: object) => void;
    onPose({ check: performerCheck("Cy") });
    expect(calls).toEqual([]);
    onPose({ check: performerCheck("Ada") });
    onPose({ check: performerCheck("Ada") });
    await soon();
    expect(calls.map(({ path }) => path)).toEqual(["/v1/models/m-Ada/files/viewer.splats"]);
    // no graphics here: then the camera alone is shown
    expect(find<HTMLElement>(element, "self-view").hidden).toBe(true);
    close();
    expect(watchPoses).toHaveBeenLastCalledWith(null);
  });

  it("shows one's model from the start, where the meeting's picture is of others", () => {
    const { element, watchPoses, live, update } = view(performer("Ada", own));
    expect([element.hidden, watchPoses.mock.calls]).toEqual([true, []]);
    live.meeting.performers.push(performer("Cy"));
    update();
    update(); // each roster says so again
    expect([element.hidden, element.getAttribute("aria-label"), watchPoses.mock.calls.length]).toEqual([false, "You", 1]);
    live.meeting.performers.pop();
    update();
    expect([element.hidden, watchPoses.mock.lastCall]).toEqual([true, [null]]);
  });

  it.each([
    ["none", [performer("Ada", demo), performer("Cy")]],
    ["several models, of which none is the one", [performer("Ada", own), performer("Bo", own), performer("Cy")]],
  ])("shows nobody who has %s", (_, performers) => {
    expect(view(...performers).element.hidden).toBe(true);
  });

  it("says what to do where one has no model", async () => {
    const { element, start, getUserMedia } = view(performer("Cy"));
    await start();
    await soon();
    expect(element.textContent).toContain("You have no model yet");
    expect(getUserMedia).not.toHaveBeenCalled();
  });

  it("stands in somebody else's meeting with the model that one has, without a question", async () => {
    stored["/v1/people"] = list({ id: "p", name: "Bo", mine: true });
    stored["/v1/models"] = list({ id: "m-Bo", person_id: "p" });
    stored["/v1/meetings/m/performers"] = json(performer("Bo", own), 201);
    const { element, start, getUserMedia, calls } = view(performer("Cy"));
    await start();
    await eventually(() => expect(element.textContent).toContain("Animating Bo."));
    expect(calls.find(({ method }) => method === "POST")?.body).toBe(JSON.stringify({ model_id: "m-Bo", motion_sequence_id: null }));
    expect(getUserMedia).toHaveBeenCalledTimes(1);
  });

  it("says why one may not stand there", async () => {
    stored["/v1/people"] = list({ id: "p", name: "Bo", mine: true });
    stored["/v1/models"] = list({ id: "m-Bo", person_id: "p" });
    stored["/v1/meetings/m/performers"] = json({ title: "The meeting is full", detail: "at most 12" }, 409);
    const { element, start } = view(performer("Cy"));
    await start();
    await eventually(() => expect(element.textContent).toContain("The meeting is full"));
  });
});
