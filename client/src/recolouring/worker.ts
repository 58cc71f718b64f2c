/** Finds the live colours of people beside the page: of each only the newest picture waits. */

import { PICTURE_PX } from "../look/cutOut";
import type { SplatFile } from "../splats/file";
import type { LaidPicture } from "../splats/laid";
import { LiveColours } from "./liveColours";
import { LookDecoder, MOST_WAITING } from "./lookDecoder";
import type { LookFrame, LookPose } from "./packets";
import { PictureReader, SIDE } from "./pictureReader";
import { WebcamView } from "./webcamView";

/** What the page tells of a person: their splats, what comes of them and whether it lays pictures, or that they end. */
export type LookTask = { person: number } & (
  | { splats: SplatFile; version: number }
  | { packet: LookFrame | LookPose; lays: boolean }
  | { ended: true }
);
/** A person's changes (`packChanges`), and their picture, of `momentMs` by the clock of the poses. */
export interface Recoloured {
  person: number;
  version: number;
  changes: Uint32Array<ArrayBuffer>;
  /** null: the page lays none. */
  laid: LaidPicture | null;
  momentMs: number;
}

/** Share of a processor that this may take: drawing comes first where there are few. */
const SHARE = navigator.hardwareConcurrency > 4 ? 0.7 : 0.25;

const reader = new PictureReader();
/** Made for the first picture that is laid; null: this browser can't draw in a worker. */
let view: WebcamView | null | undefined;
const people = new Map<number, Person>();
let timer: ReturnType<typeof setTimeout> | null = null;
let restedMs = 0;

class Person {
  workedMs = -Infinity;
  private version = 0;
  private lays = false;
  private readonly decoder = new LookDecoder(schedule);
  private splats: SplatFile | null = null;
  private colours: LiveColours | null = null;
  /** Of frames that may come yet, the newest last. */
  private poses: LookPose[] = [];

  setSplats(splats: SplatFile, version: number): void {
    this.splats = splats;
    this.version = version;
    this.colours = null;
  }

  /** The newest picture of which both frame and pose are here. */
  private get newest(): LookPose | undefined {
    return this.poses.filter(({ number }) => this.decoder.has(number)).at(-1);
  }

  /** Get ready for the first picture, which takes a moment of its own; says whether there is one to work on. */
  prepare(): boolean {
    if (!this.splats || !this.newest) return false;
    this.colours ??= new LiveColours(this.splats, SIDE);
    return true;
  }

  receive(packet: LookFrame | LookPose, lays: boolean): void {
    this.lays = lays;
    if (packet.kind === "frame") this.decoder.decode(packet);
    else this.poses = [...this.poses.slice(1 - MOST_WAITING), packet];
  }

  /** What the newest picture changes; null where none is ready. */
  work(): Omit<Recoloured, "person"> | null {
    const { colours, newest, version } = this;
    const frame = newest && this.decoder.take(newest.number);
    if (!colours || !newest || !frame) return null;
    const { number, pose, lens } = newest;
    this.poses = this.poses.filter((one) => one.number > number);
    if (this.lays && view === undefined) view = makeView();
    const { picture, fine } = reader.read(frame, this.lays && view !== null);
    frame.close();
    const scale = SIDE / PICTURE_PX;
    colours.see(picture, pose, [lens[0] * scale, lens[1] * scale, lens[2] * scale, lens[3] * scale]);
    const changes = colours.changesAt(pose.captureTimeMs / 1000);
    const laid = fine && view ? colours.laidPicture(fine, view) : null;
    return { version, changes, laid, momentMs: pose.captureTimeMs };
  }

  end(): void {
    this.decoder.close();
    this.poses = [];
    this.colours = null;
  }
}

function makeView(): WebcamView | null {
  try {
    return new WebcamView(new OffscreenCanvas(1, 1));
  } catch {
    return null;
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
    if (!one.prepare()) continue;
    const startMs = performance.now();
    const found = one.work();
    if (!found) continue;
    postMessage({ person, ...found } satisfies Recoloured, { transfer: buffersOf(found) });
    one.workedMs = performance.now();
    restedMs = one.workedMs + (one.workedMs - startMs) * (1 / SHARE - 1);
    schedule();
    return;
  }
}

function buffersOf({ changes, laid }: Pick<Recoloured, "changes" | "laid">): ArrayBuffer[] {
  return [changes.buffer, ...(laid ? [laid.detail.buffer, laid.places.buffer] : [])];
}

addEventListener("message", ({ data }: MessageEvent<LookTask>) => {
  const one = people.get(data.person) ?? new Person();
  people.set(data.person, one);
  if ("splats" in data) one.setSplats(data.splats, data.version);
  else if ("packet" in data) one.receive(data.packet, data.lays);
  else one.end();
  schedule();
});
