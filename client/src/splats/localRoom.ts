/** The room drawn by this device: fetches its people once, then draws them as poses come. */

import { decodePose, isNewer, performerCheck, type PosePacket } from "../packets";
import type { Size } from "../framing";
import type { Performer } from "../types";
import type { CameraPose } from "../viewpoint";
import { castOf, shareWithin, type Cast } from "./cast";
import { readSplats } from "./file";
import { passCamera, SplatPass, type PassCamera } from "./pass";
import { contactShadows, type Shadow } from "./room";
import { skin, TRANSFORM } from "./skeleton";
import { depthOrder, depthRows, depths, emptyOrder } from "./sort";
import type { Sorted, SortTask } from "./sortWorker";

/** Poses older than this show a connection that is gone, or a server that draws by itself. */
const STALE_MS = 1000;
const TRIAL_FRAMES = 3;

/** The file of a model; null where it has none that a page can draw. */
export type LoadSplats = (modelId: string) => Promise<ArrayBuffer | null>;

export class LocalRoom {
  /** Everybody's splats are here. */
  onLoaded: () => void = () => undefined;
  /** The server speaks of other people than we know. */
  onStrangers: () => void = () => undefined;
  /** Why this device can't draw the room, in words for its viewer; null where it can or may yet. */
  obstacle: string | null = null;

  private readonly pass: SplatPass | null;
  private readonly worker = new Worker(new URL("./sortWorker.ts", import.meta.url), { type: "module" });
  private readonly files = new Map<string, Promise<ArrayBuffer | null>>();
  private performers: readonly Performer[] = [];
  private cast: Cast | null = null;
  private casts = 0;
  private poses: PosePacket[] = [];
  private heardMs = -Infinity;
  private posed = false;
  private transforms = new Float32Array(0);
  private shadows: Shadow[] = [];
  private sorted: Sorted | null = null;
  private spare: Uint32Array<ArrayBuffer> | null = null;
  private resorted = false;
  private drawn = "";
  /** Counts what was to be seen so far, and says which of it the worker was given last. */
  private version = 0;
  private sortedVersion = 0;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly load: LoadSplats,
  ) {
    this.pass = this.makePass();
    this.worker.addEventListener("message", ({ data }: MessageEvent<Sorted>) => this.take(data));
    this.canvas.addEventListener("webglcontextlost", () => {
      this.obstacle = "The graphics of this device have stopped";
      this.cast = null;
    });
  }

  get loaded(): boolean {
    return this.cast !== null;
  }

  /** Who stands in the room; fetches whom it does not know yet. Throws a Problem. */
  async setPerformers(performers: readonly Performer[]): Promise<void> {
    const same = (one: Performer, at: number): boolean =>
      one.id === this.performers[at]?.id && one.model_id === this.performers[at]?.model_id;
    const known = performers.length === this.performers.length && performers.every(same);
    if (!this.pass || (known && this.cast)) return;
    this.performers = performers;
    this.cast = null;
    this.poses = [];
    const files = await Promise.all(performers.map(({ model_id: id }) => this.file(id)));
    if (this.performers === performers) this.assemble(files);
  }

  /** Another connection: what it sends has nothing to do with the numbers of the last one. */
  forgetPoses(): void {
    this.poses = [];
  }

  /** A pose from the server; old ones change nothing. */
  accept(bytes: ArrayBuffer): void {
    const pose = decodePose(bytes);
    if (!pose || !this.cast) return;
    const performer = this.performers[pose.index];
    if (pose.count !== this.performers.length || !performer || performerCheck(performer.id) !== pose.check) {
      this.onStrangers();
      return;
    }
    const last = this.poses[pose.index];
    if (last && !isNewer(pose.sequence, last.sequence)) return;
    this.poses[pose.index] = pose;
    this.heardMs = performance.now();
    this.posed = true;
  }

  /** Whether poses of everybody are coming. */
  get standing(): boolean {
    if (!this.cast || performance.now() - this.heardMs > STALE_MS) return false;
    return this.performers.every((_, index) => this.poses[index] !== undefined);
  }

  /** Draw what has changed since the last time; says whether a picture was drawn. */
  draw(view: CameraPose, fovYRad: number, { width, height }: Size, filmedOnly: boolean): boolean {
    const { cast, pass } = this;
    if (!cast || !pass || !this.standing) return false;
    if (this.posed) this.pose(cast);
    const camera = passCamera(view, fovYRad, width, height);
    const key = [...camera.worldToCamera, width, height, filmedOnly].join();
    const changed = this.posed || key !== this.drawn;
    this.posed = false;
    this.drawn = key;
    if (changed) this.version += 1;
    this.sort(camera);
    const sorted = this.sorted;
    if (!sorted || !(changed || this.resorted)) return false;
    this.resorted = false;
    const { transforms, shadows } = this;
    pass.draw({ camera, transforms, shadows, filmedOnly, order: sorted.order, count: sorted.count });
    return true;
  }

  /** Pictures of `size` that this device draws a second: a short trial, everybody at rest. */
  trialFps(view: CameraPose, fovYRad: number, { width, height }: Size): number {
    const { cast, pass } = this;
    if (!cast || !pass) return 0;
    this.pose(cast, (index) => this.performers[index]?.position);
    const camera = passCamera(view, fovYRad, width, height);
    const depth = new Float32Array(cast.count);
    const order = emptyOrder(cast.count);
    depths(cast.bound, depthRows(this.transforms, camera.worldToCamera), depth);
    const count = depthOrder(depth, order);
    let startMs = 0;
    for (let frame = 0; frame <= TRIAL_FRAMES; frame++) {
      const { transforms, shadows } = this;
      pass.draw({ camera, transforms, shadows, filmedOnly: false, order, count });
      pass.read(1); // waits for the card
      if (frame === 0) startMs = performance.now(); // the first one also makes the shaders ready
    }
    return (1000 * TRIAL_FRAMES) / Math.max(performance.now() - startMs, 0.1);
  }

  close(): void {
    this.worker.terminate();
    this.pass?.close();
    this.canvas.remove();
  }

  private makePass(): SplatPass | null {
    try {
      return new SplatPass(this.canvas);
    } catch {
      this.obstacle = "This browser can’t draw people by itself";
      return null;
    }
  }

  private file(modelId: string): Promise<ArrayBuffer | null> {
    const known = this.files.get(modelId);
    if (known) return known;
    const asked = this.load(modelId);
    this.files.set(modelId, asked);
    asked.catch(() => this.files.delete(modelId));
    return asked;
  }

  private assemble(given: readonly (ArrayBuffer | null)[]): void {
    const files = given.filter((file) => file !== null);
    this.obstacle = null;
    if (given.length === 0) this.obstacle = "Nobody is here yet";
    if (files.length < given.length) this.obstacle = "Somebody here can only be drawn by the server";
    if (this.obstacle !== null) return;
    const whole = files.map((file) => readSplats(file));
    const share = shareWithin(whole.map(({ count }) => count));
    const people = share < 1 ? files.map((file) => readSplats(file, share)) : whole;
    const cast = castOf(people);
    this.cast = cast;
    this.transforms = new Float32Array(TRANSFORM * cast.joints);
    this.sorted = null;
    this.spare = emptyOrder(cast.count);
    this.pass?.setCast(cast);
    this.casts += 1;
    this.worker.postMessage({ cast: this.casts, bound: cast.bound } satisfies SortTask);
    this.onLoaded();
  }

  /** Transforms and shadows of everybody: as they stand, or at rest at the given places. */
  private pose(cast: Cast, place?: (index: number) => readonly number[] | undefined): void {
    let at = 0;
    this.shadows = cast.people.flatMap((person, index) => {
      const [x = 0, y = 0, z = 0] = place?.(index) ?? [];
      const [px = 0, py = 0, pz = 0] = person.restJoints;
      const pelvis = place ? [x + px, y + py, z + pz] : (this.poses[index]?.pelvis ?? []);
      const turns = place ? restTurns(person.parents.length) : (this.poses[index]?.turns ?? []);
      skin(person, pelvis, turns, this.transforms, at);
      const shadows = contactShadows(person, this.transforms, at);
      at += TRANSFORM * person.parents.length;
      return shadows;
    });
  }

  /** Have the worker sort for the newest view, unless it is still at the last one. */
  private sort(camera: PassCamera): void {
    const order = this.spare;
    if (!order || this.sortedVersion === this.version) return;
    this.spare = null;
    this.sortedVersion = this.version;
    const rows = depthRows(this.transforms, camera.worldToCamera);
    const task: SortTask = { cast: this.casts, rows, order };
    this.worker.postMessage(task, [order.buffer]);
  }

  private take(sorted: Sorted): void {
    if (sorted.cast !== this.casts) return;
    // two orders take turns: one is shown while the worker fills the other
    this.spare = this.sorted?.order ?? emptyOrder(this.cast?.count ?? 0);
    this.sorted = sorted;
    this.resorted = true;
  }
}

function restTurns(joints: number): number[] {
  return Array.from({ length: 4 * joints }, (_, i) => (i % 4 === 0 ? 1 : 0));
}
