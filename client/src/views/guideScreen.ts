/** The camera's picture with what was found in it, what to do, how it goes, and how far it is. */

import type { Landmarks } from "../landmarks/landmarks";
import { drawSkeleton } from "../landmarks/skeleton";
import { announce, h } from "./dom";

const AS_ASKED = "#7be8cf";
const NOT_YET = "#f0bd5e";

export interface GuideScreen {
  element: HTMLElement;
  video: HTMLVideoElement;
  canvas: HTMLCanvasElement;
  /** What to do, and how it goes. */
  say(instruction: string, words: string, isGood?: boolean): void;
  progress(share: number): void;
  /** Lines over whom the picture shows; `isGood`: as they should be. */
  draw(seen: Landmarks | null, isGood: boolean): void;
  /** A step is passed. */
  flash(): void;
  play(stream: MediaStream): Promise<void>;
}

export function guideScreen(): GuideScreen {
  const video = h("video", { muted: true, playsInline: true, autoplay: true, attributes: { "aria-label": "Your camera" } });
  const canvas = h("canvas", { attributes: { "aria-hidden": "true" } });
  const instruction = h("p", { className: "guide-instruction", testId: "guide-instruction" });
  const words = h("p", { className: "guide-words", testId: "guide-words" });
  const share = h("div", { className: "bar-fill" });
  const attributes = { role: "progressbar", "aria-label": "This step", "aria-valuemin": "0", "aria-valuemax": "100" };
  const progressBar = h("div", { className: "bar", testId: "guide-progress", attributes }, share);
  const picture = h("div", { className: "guide-picture" }, video, canvas);
  const element = h("div", { className: "guide-screen" }, instruction, words, picture, progressBar);
  video.addEventListener("resize", () => element.style.setProperty("--shape", String(video.videoWidth / video.videoHeight)));
  return {
    element,
    video,
    canvas,
    say: (doing, how, isGood = false) => {
      if (instruction.textContent !== doing) announce(doing);
      if (words.textContent !== how) announce(how);
      instruction.textContent = doing;
      words.textContent = how;
      words.classList.toggle("good", isGood);
    },
    progress: (done) => {
      share.style.setProperty("--share", String(done));
      progressBar.setAttribute("aria-valuenow", String(Math.round(100 * done)));
    },
    draw: (seen, isGood) => {
      drawSkeleton(canvas, seen, isGood ? AS_ASKED : NOT_YET);
      element.dataset["found"] = String(seen !== null);
    },
    flash: () => picture.animate?.([{ boxShadow: "0 0 0 6px var(--accent)" }, { boxShadow: "0 0 0 0 var(--accent)" }], 900),
    play: async (stream) => {
      video.srcObject = stream;
      await video.play();
    },
  };
}
