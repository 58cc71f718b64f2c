/** Filming oneself: the camera's picture, a countdown, one guided turn, and a look at the result. */

import type { Clip } from "../enrolment/enrol";
import { asProblem } from "../api/problem";
import { sleep } from "../api/until";
import { CAMERA_GONE, COUNTDOWN_S, TURN_S, closeCamera, turnInstruction, openCamera, recordTurn } from "../capture/record";
import { announce, h } from "./dom";
import { button, notice, type View } from "./shell";

/** `onClip` gets the clip when it is filmed, and null when it is discarded. */
export function recorder(onClip: (clip: Clip | null) => void): View {
  const closing = new AbortController();
  let takes = new AbortController();
  let stream: MediaStream | null = null;
  let clipAddress: string | null = null;

  const video = h("video", { className: "mirror", muted: true, playsInline: true, autoplay: true });
  const words = h("p", { className: "instruction" });
  const ring = h("div", { className: "ring", attributes: { "aria-hidden": "true" } });
  const screen = h("div", { className: "camera-preview" }, video, ring, words);
  const bar = h("div", { className: "actions" });
  const element = h("div", { className: "recorder" }, screen, bar);

  const say = (text: string, share = 0): void => {
    words.textContent = text;
    ring.style.setProperty("--share", String(share));
    announce(text);
  };

  const ready = (): void => {
    forget();
    onClip(null);
    video.controls = video.loop = false;
    video.classList.add("mirror");
    video.src = "";
    video.srcObject = stream;
    void video.play().catch(() => undefined);
    say("Step back until your whole body is in view");
    bar.replaceChildren(button("Start recording", () => void film(), { look: "primary", icon: "camera" }));
  };

  const film = async (): Promise<void> => {
    if (!stream) return;
    takes = new AbortController();
    const { signal } = takes;
    bar.replaceChildren(button("Stop", () => takes.abort()));
    screen.classList.add("filming");
    try {
      for (let second = COUNTDOWN_S; second > 0; second--) {
        say(`Recording starts in ${second}`);
        await sleep(1000, signal);
      }
      const onSecond = (second: number): void => say(turnInstruction(second), second / TURN_S);
      review(await recordTurn(stream, onSecond, signal));
    } catch (error) {
      if (closing.signal.aborted) return;
      if (signal.aborted) ready();
      else refused(error);
    } finally {
      screen.classList.remove("filming");
    }
  };

  const review = (clip: Clip): void => {
    forget();
    clipAddress = URL.createObjectURL(clip.blob);
    video.classList.remove("mirror");
    video.srcObject = null;
    video.src = clipAddress;
    video.loop = true;
    void video.play().catch(() => undefined);
    say("");
    onClip(clip);
    bar.replaceChildren(button("Record again", ready, { icon: "reset" }));
  };

  const refused = (error: unknown): void => {
    element.replaceChildren(notice(asProblem(error), button("Try again", () => void open())));
  };

  const open = async (): Promise<void> => {
    element.replaceChildren(screen, bar);
    bar.replaceChildren();
    say("Starting the camera…");
    try {
      const opened = await openCamera();
      if (closing.signal.aborted) return closeCamera(opened);
      stream = opened;
      stream.getVideoTracks()[0]?.addEventListener("ended", () => {
        takes.abort();
        refused(CAMERA_GONE);
      });
      ready();
    } catch (error) {
      refused(error);
    }
  };

  const forget = (): void => {
    if (clipAddress) URL.revokeObjectURL(clipAddress);
    clipAddress = null;
  };

  void open();
  return {
    element,
    close: () => {
      closing.abort();
      takes.abort();
      forget();
      closeCamera(stream);
    },
  };
}
