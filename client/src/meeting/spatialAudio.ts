/**
 * Spatial audio: each voice comes from where its speaker stands, as two ears
 * at the viewpoint would hear it (HRTF). A speaker whom nobody stands for is heard from ahead.
 */

import type { Quaternion, Vec3 } from "../viewpoint/geometry";

/** Where the listener's head is: of the picture's camera (OpenCV axes), or of a headset. */
export interface ListenerPose {
  position: Vec3;
  wxyz: Quaternion;
}

export interface VoiceSource {
  memberId: string;
  stream: MediaStream;
}

interface PannedVoice extends VoiceSource {
  /** Chromium hands a remote voice to Web Audio only while an element plays it, too. */
  element: HTMLAudioElement;
  source: MediaStreamAudioSourceNode;
  panner: PannerNode;
}

/** At this distance a voice is as loud as it was sent, m; nobody is far away in a meeting. */
const REFERENCE_DISTANCE_M = 1.5;
const ROLL_OFF = 0.6;
/** Time constant of moves, s: steps would click. */
const RAMP_S = 0.03;
const AHEAD_M = 1;

export class SpatialAudio {
  /** What is to be played. */
  readonly output: MediaStream;
  private readonly destination: MediaStreamAudioDestinationNode;
  private readonly voices = new Map<number, PannedVoice>();

  constructor(private readonly context: AudioContext = new AudioContext()) {
    this.destination = context.createMediaStreamDestination();
    this.output = this.destination.stream;
  }

  /** Who is heard in which track from now on. */
  setVoices(slots: ReadonlyMap<number, VoiceSource>): void {
    for (const [slot, voice] of this.voices) {
      const next = slots.get(slot);
      if (next?.stream === voice.stream) voice.memberId = next.memberId;
      else this.remove(slot, voice);
    }
    for (const [slot, speaking] of slots) {
      if (!this.voices.has(slot)) this.voices.set(slot, this.voice(speaking));
    }
  }

  /** Put ears and speakers where they are; `headOf` is null for whom nobody stands. */
  setPositions(listenerPose: ListenerPose, headOf: (memberId: string) => Vec3 | null): void {
    const ahead = rotated(listenerPose.wxyz, [0, 0, 1]);
    const up = rotated(listenerPose.wxyz, [0, -1, 0]);
    const { listener } = this.context;
    this.ramp(listener, ["positionX", "positionY", "positionZ"], listenerPose.position);
    this.ramp(listener, ["forwardX", "forwardY", "forwardZ"], ahead);
    this.ramp(listener, ["upX", "upY", "upZ"], up);
    const before: Vec3 = [
      listenerPose.position[0] + AHEAD_M * ahead[0],
      listenerPose.position[1] + AHEAD_M * ahead[1],
      listenerPose.position[2] + AHEAD_M * ahead[2],
    ];
    for (const { memberId, panner } of this.voices.values()) {
      this.ramp(panner, ["positionX", "positionY", "positionZ"], headOf(memberId) ?? before);
    }
  }

  /** What loudspeakers or headphones take, ms, as far as the browser knows. */
  get outputLatencyMs(): number {
    return 1000 * (this.context.outputLatency || 0);
  }

  /** Browsers start sound only after a touch. */
  async resume(): Promise<void> {
    if (this.context.state === "suspended") await this.context.resume();
  }

  close(): void {
    for (const [slot, voice] of this.voices) this.remove(slot, voice);
    void this.context.close();
  }

  private voice({ memberId, stream }: VoiceSource): PannedVoice {
    const element = new Audio();
    element.muted = true;
    element.srcObject = stream;
    const panner = this.context.createPanner();
    panner.panningModel = "HRTF";
    panner.distanceModel = "inverse";
    panner.refDistance = REFERENCE_DISTANCE_M;
    panner.rolloffFactor = ROLL_OFF;
    const source = this.context.createMediaStreamSource(stream);
    source.connect(panner).connect(this.destination);
    return { memberId, stream, element, source, panner };
  }

  private remove(slot: number, { source, panner, element }: PannedVoice): void {
    source.disconnect();
    panner.disconnect();
    element.srcObject = null;
    this.voices.delete(slot);
  }

  private ramp<Name extends string>(
    node: Record<Name, AudioParam>,
    names: readonly [Name, Name, Name],
    to: Vec3,
  ): void {
    names.forEach((name, axis) => node[name].setTargetAtTime(to[axis] ?? 0, this.context.currentTime, RAMP_S));
  }
}

/** `v` turned by a unit quaternion. */
export function rotated([w, x, y, z]: Quaternion, [a, b, c]: Vec3): Vec3 {
  const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
}
