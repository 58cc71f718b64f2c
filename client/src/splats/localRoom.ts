/** The room drawn by this device: fetches its people once, then draws them as poses come. */

import { decodePose, isNewer, performerCheck, type PosePacket } from "../transport/packets";
import type { Size } from "../viewpoint/framing";
import type { Performer } from "../api/types";
import type { CameraPose } from "../viewpoint/viewpoint";
import { castOf, shareWithin, type Cast } from "./cast";
import { growthOf, readSplats, type SplatFile } from "./file";
import { emptyOffsets, moveSplats } from "./moved";
import { passCamera, SplatPass, type Eye, type PassCamera, type PassPeople } from "./pass";
import { contactShadows, type Place, type Shadow } from "./room";
import { skin, TRANSFORM } from "./skeleton";
import { depthOrder, depthRows, depths, emptyOrder } from "./sort";
import type { Sorted, SortTask } from "./sortWorker";

/** Poses older than this show a connection that is gone, or a server that draws by itself. */
const STALE_MS = 1000;
const TRIAL_FRAMES = 3;
const SERVER_ONLY = "Somebody here can only be drawn by the server";
const NOBODY: PassPeople = {
  transforms: new Float32Array(TRANSFORM),
  offsets: emptyOffsets(0),
  order: emptyOrder(0),
  count: 0,
  growth: [],
  yawsRad: [],
  shadows: [],
  filmedOnly: false,
};

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
  private offsets = emptyOffsets(0);
  private expressed = "";
  private shadows: Shadow[] = [];
  private sorted: Sorted | null = null;
  private spare: Uint32Array<ArrayBuffer> | null = null;
  private resorted = false;
  private drawn = "";
  private screen: HTMLVideoElement | null = null;
  private watching = 0;
  /** Counts what was to be seen so far, and says which of it the worker was given last. */
  private version = 0;
  private sortedVersion = 0;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly load: LoadSplats,
    private readonly xrCompatible = false,
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

  /**
   * Who stands in the room; fetches whom it does not know yet. Who gets a better model meanwhile is
   * drawn by the one before until that has come. Throws a Problem.
   */
  async setPerformers(performers: readonly Performer[]): Promise<void> {
    const before = this.performers;
    const alike = (key: "id" | "model_id"): boolean =>
      performers.length === before.length && performers.every((one, at) => one[key] === before[at]?.[key]);
    if (!this.pass || (alike("id") && alike("model_id") && this.cast)) return;
    this.performers = performers;
    if (!alike("id")) {
      this.cast = null;
      this.poses = [];
    }
    try {
      const files = await Promise.all(performers.map(({ model_id: id }) => this.file(id)));
      if (this.performers === performers) this.assemble(files);
    } catch (error) {
      if (this.performers === performers) this.performers = []; // to be asked for again
      throw error;
    }
  }

  /** Where everybody is from now on; shown with the next picture. */
  setPlace(place: Place): void {
    this.pass?.setPlace(place);
    this.drawn = "";
  }

  /** A screen that is shared now, each of its pictures with the next of the room; null: none. */
  setScreen(video: HTMLVideoElement | null): void {
    this.screen?.cancelVideoFrameCallback(this.watching);
    this.screen = video;
    if (!video) this.pass?.setScreen(null);
    else this.watchScreen(video);
    this.drawn = "";
  }

  private watchScreen(video: HTMLVideoElement): void {
    this.watching = video.requestVideoFrameCallback(() => {
      if (this.screen !== video) return;
      this.pass?.setScreen(video, video.videoWidth, video.videoHeight);
      this.drawn = "";
      this.watchScreen(video);
    });
  }

  /** Another connection: what it sends has nothing to do with the numbers of the last one. */
  forgetPoses(): void {
    this.poses = [];
  }

  /** A pose from the server; old ones change nothing. */
  accept(bytes: ArrayBuffer): void {
    const pose = decodePose(bytes);
    if (pose) this.stand(pose);
  }

  /** A pose of somebody; old ones change nothing. */
  stand(pose: PosePacket): void {
    if (!this.cast) return;
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
  get drawable(): boolean {
    if (!this.cast || performance.now() - this.heardMs > STALE_MS) return false;
    return this.performers.every((_, index) => this.poses[index] !== undefined);
  }

  /** Draw what has changed since the last time; says whether a picture was drawn. */
  draw(view: CameraPose, fovYRad: number, { width, height }: Size, filmedOnly: boolean): boolean {
    const { cast, pass } = this;
    if (!cast || !pass || !this.drawable) return false;
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
    pass.draw({ camera, ...this.people(cast, sorted, filmedOnly) });
    return true;
  }

  /** When the newest pose was captured, ms, where the server stamps pictures; see `stamp`. */
  get capturedMs(): number | null {
    return this.poses.reduce<number | null>((ms, pose) => Math.max(ms ?? 0, pose.captureTimeMs), null);
  }

  /** What a headset draws into; null where this browser can't draw people by itself. */
  get graphics(): WebGL2RenderingContext | null {
    return this.pass?.gl ?? null;
  }

  /** Splats of each person; none before they are here. */
  get counts(): readonly number[] {
    return this.cast?.bound.counts ?? [];
  }

  /** Where everybody's pelvis is, m; at their place until they move. */
  get places(): readonly (readonly [number, number, number])[] {
    return this.performers.map((performer, index) => this.poses[index]?.pelvis ?? performer.position);
  }

  /**
   * Draw the room into both eyes of a headset, whether or not anything changed: what is not drawn
   * there is black. The first `kept` splats of each person are drawn, sorted once, for `head`. Says
   * whether people are in the picture.
   */
  drawEyes(eyes: readonly Eye[], head: PassCamera, filmedOnly: boolean, kept: readonly number[]): boolean {
    const { cast, pass } = this;
    if (!pass) return false;
    const drawable = cast !== null && this.drawable;
    if (cast && drawable) {
      if (this.posed) this.pose(cast);
      this.posed = false;
      this.version += 1;
      this.sort(head, kept);
    }
    const sorted = drawable ? this.sorted : null;
    pass.drawEyes(cast && sorted ? this.people(cast, sorted, filmedOnly) : NOBODY, eyes);
    return sorted !== null;
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
      pass.draw({ camera, ...this.people(cast, { order, count, kept: cast.bound.counts }, false) });
      pass.read(1); // waits for the card
      if (frame === 0) startMs = performance.now(); // the first one also makes the shaders ready
    }
    return (1000 * TRIAL_FRAMES) / Math.max(performance.now() - startMs, 0.1);
  }

  close(): void {
    this.screen?.cancelVideoFrameCallback(this.watching);
    this.screen = null;
    this.worker.terminate();
    this.pass?.close();
    this.canvas.remove();
  }

  private makePass(): SplatPass | null {
    try {
      return new SplatPass(this.canvas, this.xrCompatible);
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

  /** Everybody's splats; null, and an obstacle, for files that another release wrote. */
  private readAll(files: readonly ArrayBuffer[]): SplatFile[] | null {
    try {
      return files.map((file) => readSplats(file));
    } catch {
      this.obstacle = SERVER_ONLY;
      return null;
    }
  }

  private assemble(given: readonly (ArrayBuffer | null)[]): void {
    const files = given.filter((file) => file !== null);
    this.obstacle = null;
    if (given.length === 0) this.obstacle = "Nobody is here yet";
    if (files.length < given.length) this.obstacle = SERVER_ONLY;
    if (this.obstacle !== null) return;
    const whole = this.readAll(files);
    if (!whole) return;
    const share = shareWithin(whole.map(({ count }) => count));
    const people = share < 1 ? files.map((file) => readSplats(file, share)) : whole;
    const cast = castOf(people);
    this.cast = cast;
    this.transforms = new Float32Array(TRANSFORM * cast.joints);
    this.offsets = emptyOffsets(cast.moved);
    this.expressed = "";
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
    this.express(cast);
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

  /** Move the splats of faces and hands, where anybody's changed. */
  private express(cast: Cast): void {
    const shown = this.performers.map((_, index) => this.poses[index]?.expression ?? []);
    const key = shown.join(";");
    if (key === this.expressed) return;
    this.expressed = key;
    this.offsets = emptyOffsets(cast.moved); // another array: the card's is to be written anew
    let first = 0;
    for (const [index, { moved }] of cast.people.entries()) {
      moveSplats(moved, shown[index] ?? [], this.offsets, first);
      first += moved.splats.length;
    }
  }

  /** Have the worker sort for the newest view, unless it is still at the last one. */
  private sort(camera: PassCamera, kept: readonly number[] = this.counts): void {
    const order = this.spare;
    if (!order || this.sortedVersion === this.version) return;
    this.spare = null;
    this.sortedVersion = this.version;
    const rows = depthRows(this.transforms, camera.worldToCamera);
    const task: SortTask = { cast: this.casts, rows, order, kept };
    this.worker.postMessage(task, [order.buffer]);
  }

  private people(cast: Cast, { order, count, kept }: Omit<Sorted, "cast">, filmedOnly: boolean): PassPeople {
    const { transforms, offsets, shadows } = this;
    const growth = cast.bound.counts.map((whole, person) => growthOf(whole, kept[person] ?? whole));
    const yawsRad = this.performers.map((performer) => performer.yaw_rad);
    return { transforms, offsets, shadows, order, count, growth, yawsRad, filmedOnly };
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
