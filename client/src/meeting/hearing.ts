/**
 * Others as they are heard in the room: each voice comes from where its speaker stands, as two ears
 * at the viewpoint would hear it (HRTF). A speaker whom nobody stands for is heard from ahead.
 */

import type { Quaternion, Vec3 } from "../viewpoint/geometry";

/** Where the listener's head is: of the picture's camera (OpenCV axes), or of a headset. */
export interface Ears {
  position: Vec3;
  wxyz: Quaternion;
}

export interface Speaking {
  memberId: string;
  stream: MediaStream;
}

interface Voice extends Speaking {
  /** Chromium hands a remote voice to Web Audio only while an element plays it, too. */
  element: HTMLAudioElement;
  source: MediaStreamAudioSourceNode;
  panner: PannerNode;
}

/** At this distance a voice is as loud as it was sent, m; nobody is far away in a meeting. */
const CONVERSATION_M = 1.5;
const ROLL_OFF = 0.6;
/** Time constant of moves, s: steps would click. */
const GLIDE_S = 0.03;
const AHEAD_M = 1;

export class Hearing {
  /** What is to be played. */
  readonly mix: MediaStream;
  private readonly mixed: MediaStreamAudioDestinationNode;
  private readonly voices = new Map<number, Voice>();

  constructor(private readonly context: AudioContext = new AudioContext()) {
    this.mixed = context.createMediaStreamDestination();
    this.mix = this.mixed.stream;
  }

  /** Who is heard in which track from now on. */
  show(slots: ReadonlyMap<number, Speaking>): void {
    for (const [slot, voice] of this.voices) {
      const next = slots.get(slot);
      if (next?.stream === voice.stream) voice.memberId = next.memberId;
      else this.drop(slot, voice);
    }
    for (const [slot, speaking] of slots) {
      if (!this.voices.has(slot)) this.voices.set(slot, this.voice(speaking));
    }
  }

  /** Put ears and speakers where they are; `headOf` is null for whom nobody stands. */
  place(ears: Ears, headOf: (memberId: string) => Vec3 | null): void {
    const ahead = turned(ears.wxyz, [0, 0, 1]);
    const up = turned(ears.wxyz, [0, -1, 0]);
    const { listener } = this.context;
    this.glide(listener, ["positionX", "positionY", "positionZ"], ears.position);
    this.glide(listener, ["forwardX", "forwardY", "forwardZ"], ahead);
    this.glide(listener, ["upX", "upY", "upZ"], up);
    const before: Vec3 = [
      ears.position[0] + AHEAD_M * ahead[0],
      ears.position[1] + AHEAD_M * ahead[1],
      ears.position[2] + AHEAD_M * ahead[2],
    ];
    for (const { memberId, panner } of this.voices.values()) {
      this.glide(panner, ["positionX", "positionY", "positionZ"], headOf(memberId) ?? before);
    }
  }

  /** Browsers start sound only after a touch. */
  async resume(): Promise<void> {
    if (this.context.state === "suspended") await this.context.resume();
  }

  close(): void {
    for (const [slot, voice] of this.voices) this.drop(slot, voice);
    void this.context.close();
  }

  private voice({ memberId, stream }: Speaking): Voice {
    const element = new Audio();
    element.muted = true;
    element.srcObject = stream;
    const panner = this.context.createPanner();
    panner.panningModel = "HRTF";
    panner.distanceModel = "inverse";
    panner.refDistance = CONVERSATION_M;
    panner.rolloffFactor = ROLL_OFF;
    const source = this.context.createMediaStreamSource(stream);
    source.connect(panner).connect(this.mixed);
    return { memberId, stream, element, source, panner };
  }

  private drop(slot: number, { source, panner, element }: Voice): void {
    source.disconnect();
    panner.disconnect();
    element.srcObject = null;
    this.voices.delete(slot);
  }

  private glide<Name extends string>(
    node: Record<Name, AudioParam>,
    names: readonly [Name, Name, Name],
    to: Vec3,
  ): void {
    names.forEach((name, axis) => node[name].setTargetAtTime(to[axis] ?? 0, this.context.currentTime, GLIDE_S));
  }
}

/** `v` turned by a unit quaternion. */
export function turned([w, x, y, z]: Quaternion, [a, b, c]: Vec3): Vec3 {
  const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
}
