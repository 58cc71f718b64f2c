/** Finds the live colours of people beside the page: of each only the newest picture waits. */

import { PICTURE_PX } from "../look/cutOut";
import type { SplatFile } from "../splats/file";
import { LiveColours } from "./liveColours";
import { LookDecoder } from "./lookDecoder";
import type { LookFrame, LookPose } from "./packets";
import { PictureReader } from "./pictureReader";

/** What the page tells of a person: their splats, what comes of them, or that nothing comes any more. */
export type LookTask = { person: number } & (
  | { splats: SplatFile; version: number }
  | { packet: LookFrame | LookPose }
  | { ended: true }
);
/** A person's changes (`packChanges`) by their picture of `momentMs`, by the clock of the poses. */
export interface Recoloured {
  person: number;
  version: number;
  changes: Uint32Array<ArrayBuffer>;
  momentMs: number;
}

/** Pictures are made so large, px: half of what is sent, for a quarter of the work. */
const SIDE = PICTURE_PX / 2;
/** Share of a processor that this may take: drawing comes first where there are few. */
const SHARE = navigator.hardwareConcurrency > 4 ? 0.7 : 0.25;

const reader = new PictureReader(SIDE);
const people = new Map<number, Person>();
let timer: ReturnType<typeof setTimeout> | null = null;
let restedMs = 0;

class Person {
  workedMs = -Infinity;
  version = 0;
  private readonly decoder = new LookDecoder(schedule);
  private splats: SplatFile | null = null;
  private colours: LiveColours | null = null;
  private wanted: LookPose | null = null;

  setSplats(splats: SplatFile, version: number): void {
    this.splats = splats;
    this.version = version;
    this.colours = null;
  }

  receive(packet: LookFrame | LookPose): void {
    if (packet.kind === "frame") this.decoder.decode(packet);
    else this.wanted = packet;
  }

  /** What the newest picture changes; null where none is ready. */
  work(): Recoloured["changes"] | null {
    const frame = this.splats && this.wanted && this.decoder.take(this.wanted.number);
    if (!this.splats || !this.wanted || !frame) return null;
    const { pose, lens } = this.wanted;
    this.wanted = null;
    const picture = reader.read(frame);
    frame.close();
    this.colours ??= new LiveColours(this.splats, SIDE);
    const scale = SIDE / PICTURE_PX;
    this.colours.see(picture, pose, [lens[0] * scale, lens[1] * scale, lens[2] * scale, lens[3] * scale]);
    this.momentMs = pose.captureTimeMs;
    return this.colours.changesAt(pose.captureTimeMs / 1000);
  }

  /** Of the last picture. */
  momentMs = 0;

  end(): void {
    this.decoder.close();
    this.wanted = this.colours = null;
  }
}

function schedule(): void {
  timer ??= setTimeout(work, Math.max(0, restedMs - performance.now()));
}

/** One person's picture, whose last one was longest ago; then a rest. */
function work(): void {
  timer = null;
  const inTurn = [...people].sort(([, a], [, b]) => a.workedMs - b.workedMs);
  for (const [person, one] of inTurn) {
    const startMs = performance.now();
    const changes = one.work();
    if (!changes) continue;
    const { version, momentMs } = one;
    postMessage({ person, version, changes, momentMs } satisfies Recoloured, { transfer: [changes.buffer] });
    one.workedMs = performance.now();
    restedMs = one.workedMs + (one.workedMs - startMs) * (1 / SHARE - 1);
    schedule();
    return;
  }
}

addEventListener("message", ({ data }: MessageEvent<LookTask>) => {
  const one = people.get(data.person) ?? new Person();
  people.set(data.person, one);
  if ("splats" in data) one.setSplats(data.splats, data.version);
  else if ("packet" in data) one.receive(data.packet);
  else one.end();
  schedule();
});
