/** What was said in a recording, in time with what is shown, from where its speaker stands. */

import type { Vec3 } from "../viewpoint/geometry";
import { rotated, type ListenerPose } from "../meeting/spatialAudio";
import type { Player } from "./player";

interface Voice {
  memberId: string;
  element: HTMLAudioElement;
  panner: PannerNode;
}

/** Further apart than this the sound jumps to the picture, s. */
const MAX_DRIFT_S = 0.12;
const AHEAD_M = 1;

export class RecordedVoices {
  private readonly context = new AudioContext();
  private readonly voices: Voice[];

  /** `files`: each member's voice, from the start of the recording. */
  constructor(
    files: ReadonlyMap<string, Blob>,
    private readonly player: Player,
  ) {
    this.voices = [...files].map(([memberId, file]) => {
      const element = new Audio(URL.createObjectURL(file));
      const panner = this.context.createPanner();
      panner.panningModel = "HRTF";
      panner.refDistance = 1.5;
      panner.rolloffFactor = 0.6;
      this.context.createMediaElementSource(element).connect(panner).connect(this.context.destination);
      return { memberId, element, panner };
    });
  }

  /** Follow the player; called at each change, and now and then. */
  synchronise(): void {
    const { player } = this;
    const at = player.ms / 1000;
    for (const { element } of this.voices) {
      const ended = Number.isFinite(element.duration) && at >= element.duration;
      element.playbackRate = player.speed;
      if (!ended && Math.abs(element.currentTime - at) > MAX_DRIFT_S * player.speed) element.currentTime = at;
      if (player.playing && !ended && element.paused) {
        void this.context.resume();
        // refused only before the first touch of the page; the next change asks again
        element.play().catch(() => undefined);
      } else if ((!player.playing || ended) && !element.paused) element.pause();
    }
  }

  setPositions(ears: ListenerPose, headOf: (memberId: string) => Vec3 | null): void {
    const ahead = rotated(ears.wxyz, [0, 0, 1]);
    const up = rotated(ears.wxyz, [0, -1, 0]);
    const { listener } = this.context;
    [listener.positionX.value, listener.positionY.value, listener.positionZ.value] = ears.position;
    [listener.forwardX.value, listener.forwardY.value, listener.forwardZ.value] = ahead;
    [listener.upX.value, listener.upY.value, listener.upZ.value] = up;
    const [x, y, z] = ears.position;
    const before: Vec3 = [x + AHEAD_M * ahead[0], y + AHEAD_M * ahead[1], z + AHEAD_M * ahead[2]];
    for (const { memberId, panner } of this.voices) {
      const at = headOf(memberId) ?? before;
      [panner.positionX.value, panner.positionY.value, panner.positionZ.value] = at;
    }
  }

  close(): void {
    for (const { element } of this.voices) {
      element.pause();
      URL.revokeObjectURL(element.src);
    }
    void this.context.close();
  }
}
