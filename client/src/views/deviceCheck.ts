/** Before joining: is the camera the right one, does the microphone hear, and how does one come in? */

import type { Api } from "../api/api";
import { storeDevices, chosenDevices, loudness, openMicrophone } from "../capture/devices";
import { asProblem, type Problem } from "../api/problem";
import { closeCamera, openCamera } from "../capture/record";
import { h } from "./dom";
import { selfPreview } from "./selfPreview";
import type { View } from "./shell";

const PREVIEW = { width: 640, height: 480 };
const LEVEL_MS = 66;

/** Asks for nothing before it is opened. */
export function deviceCheck(api: Api): View {
  const camera = cameraCheck();
  const microphone = microphoneCheck();
  const self = selfPreview(api);
  const heard = h("input", { type: "checkbox", id: "join-unmuted", testId: "join-unmuted", attributes: { role: "switch" } });
  heard.checked = chosenDevices().joinUnmuted;
  heard.addEventListener("change", () => storeDevices({ joinUnmuted: heard.checked }));
  const element = h(
    "details",
    { className: "device-check", testId: "device-check" },
    h("summary", {}, "Camera and microphone"),
    h("div", { className: "device-views" }, camera.picture, self.element),
    camera.element,
    microphone.element,
    h("div", { className: "switch-row" }, h("label", { attributes: { for: heard.id } }, "Join with the microphone on"), heard),
    h("p", { className: "secondary small" }, "Both stay off in the meeting until you turn them on. Camera images never leave this device; only your movements are sent."),
  );
  const close = (): void => {
    camera.close();
    microphone.close();
    self.close();
  };
  element.addEventListener("toggle", () => {
    if (!element.open) return close();
    void camera.open();
    void microphone.open();
    void self.open();
  });
  return { element, close };
}

interface Check {
  element: HTMLElement;
  open(): Promise<void>;
  close(): void;
}

function cameraCheck(): Check & { picture: HTMLElement } {
  const video = h("video", { autoplay: true, muted: true, playsInline: true, testId: "check-camera" });
  video.setAttribute("aria-label", "Your camera");
  const picture = h("div", { className: "device-picture", hidden: true }, video);
  let stream: MediaStream | null = null;
  let asked = 0;
  const close = (): void => {
    asked += 1;
    closeCamera(stream);
    stream = video.srcObject = null;
    picture.hidden = true;
  };
  const open = async (): Promise<void> => {
    close();
    const now = asked;
    try {
      const opened = await openCamera(PREVIEW);
      if (now !== asked) return closeCamera(opened);
      picture.hidden = false;
      stream = video.srcObject = opened;
      picker.say(null);
      await picker.list(opened);
    } catch (error) {
      if (now === asked) picker.say(asProblem(error));
    }
  };
  const picker = devicePicker("videoinput", "Camera", (id) => {
    storeDevices({ camera: id });
    void open();
  });
  return { element: picker.element, picture, open, close };
}

function microphoneCheck(): Check {
  const level = h("meter", { min: 0, max: 1, testId: "check-level" });
  level.setAttribute("aria-label", "Microphone level");
  let stream: MediaStream | null = null;
  let context: AudioContext | null = null;
  let looking: ReturnType<typeof setInterval> | undefined;
  let asked = 0;
  const close = (): void => {
    asked += 1;
    clearInterval(looking);
    for (const track of stream?.getTracks() ?? []) track.stop();
    void context?.close();
    stream = context = null;
    level.value = 0;
  };
  const listen = (opened: MediaStream): void => {
    context = new AudioContext();
    const analyser = context.createAnalyser();
    context.createMediaStreamSource(opened).connect(analyser);
    const samples = new Float32Array(analyser.fftSize);
    looking = setInterval(() => {
      analyser.getFloatTimeDomainData(samples);
      level.value = loudness(samples);
    }, LEVEL_MS);
  };
  const open = async (): Promise<void> => {
    close();
    const now = asked;
    try {
      const opened = await openMicrophone();
      if (now !== asked) return opened.getTracks().forEach((track) => track.stop());
      stream = opened;
      picker.say(null);
      listen(opened);
      await picker.list(opened);
    } catch (error) {
      if (now === asked) picker.say(asProblem(error));
    }
  };
  const picker = devicePicker("audioinput", "Microphone", (id) => {
    storeDevices({ microphone: id });
    void open();
  });
  picker.element.append(level);
  return { element: picker.element, open, close };
}

interface Picker {
  element: HTMLElement;
  /** Offer what there is; names are known once one of the kind is open. */
  list(open: MediaStream): Promise<void>;
  say(problem: Problem | null): void;
}

function devicePicker(kind: MediaDeviceKind, words: string, onChoice: (id: string) => void): Picker {
  const select = h("select", { className: "field", id: `check-${kind}`, testId: `check-${kind}`, hidden: true });
  const told = h("p", { className: "field-error", testId: `problem-${kind}`, attributes: { role: "status" } });
  select.addEventListener("change", () => onChoice(select.value));
  const label = h("label", { className: "label", attributes: { for: select.id } }, words);
  return {
    element: h("div", { className: "device" }, label, select, told),
    list: async (open) => {
      const devices = (await navigator.mediaDevices.enumerateDevices()).filter((one) => one.kind === kind);
      select.replaceChildren(
        ...devices.map(({ deviceId, label: name }, at) => h("option", { value: deviceId }, name || `${words} ${at + 1}`)),
      );
      const used = open.getTracks()[0]?.getSettings().deviceId;
      if (devices.some(({ deviceId }) => deviceId === used)) select.value = used ?? "";
      select.disabled = devices.length < 2;
      select.hidden = false;
    },
    say: (problem) => {
      if (problem) select.hidden = true;
      told.textContent = problem ? `${problem.title}. ${problem.detail}` : "";
    },
  };
}
