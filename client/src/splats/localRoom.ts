/** The room drawn by this device: fetches its people once, then draws them as poses come. */

import { decodePose, isNewer, performerCheck, type PosePacket } from "../transport/packets";
import type { Size } from "../viewpoint/framing";
import type { Performer } from "../api/types";
import type { CameraPose } from "../viewpoint/viewpoint";
import { packSplats, shareWithin, type PackedSplats } from "./packed";
import { DrawTimer } from "./drawTimer";
import type { LaidPicture } from "./laid";
import { growths, readSplats, type SplatFile } from "./file";
import { finest } from "./levels";
import { allocateOffsets, moveSplats } from "./moved";
import { passCamera, type Eye, type PassCamera } from "./camera";
import { NOBODY, SplatPass, type PassPeople } from "./pass";
import { ArrivingFiles, type LoadSplats } from "./arriving";
import { withoutOwnHead } from "./ownHead";
import { contactShadows, type LoadedEnvironment, type ScreenPlace, type Shadow } from "./room";
import { forwardKinematics, restRotations, TRANSFORM } from "./skeleton";
import { SharedScreen } from "./sharedScreen";
import { allocateOrder, depthOrder, depthRows, depths, displaced } from "./sort";
import type { Sorted, SortTask } from "./sortWorker";

/** Poses older than this show a connection that is gone, or a server that draws by itself. */
const STALE_MS = 1000;
const TRIAL_FRAMES = 3;
const SERVER_ONLY = "Somebody here can only be rendered by the server";

/** Who is drawn, and where until they move. */
export type DrawnPerformer = Pick<Performer, "id" | "model_id" | "position" | "yaw_rad">;

export class LocalRoom {
  /** Everybody's splats are here, or enough of them to draw everybody. */
  onLoaded: () => void = () => undefined;
  /** The server speaks of other people than we know. */
  onUnknownPerformers: () => void = () => undefined;
  /** A picture of the page took so long, ms; told a moment after it was drawn. */
  onFinished: (tookMs: number) => void = () => undefined;
  /** Pictures may be laid on people: it draws quickly enough. */
  lays = true;
  /** Why this device can't draw the room, in words for its viewer; null where it can or may yet. */
  obstacle: string | null = null;

  private readonly pass: SplatPass | null;
  private readonly timer: DrawTimer | null;
  private readonly worker = new Worker(new URL("./sortWorker.ts", import.meta.url), { type: "module" });
  private readonly files: ArrivingFiles;
  private performers: readonly DrawnPerformer[] = [];
  private splats: PackedSplats | null = null;
  private splatsVersion = 0;
  private poses: PosePacket[] = [];
  private lastPoseMs = -Infinity;
  private posesChanged = false;
  private transforms = new Float32Array(0);
  private offsets = allocateOffsets(0);
  private appliedExpressions = "";
  private shadows: Shadow[] = [];
  private sorted: Sorted | null = null;
  private spareOrder: Uint32Array<ArrayBuffer> | null = null;
  private resorted = false;
  private drawnKey = "";
  /** Of the page's last picture. */
  private camera: PassCamera | null = null;
  private readonly screen = new SharedScreen((video) => {
    this.pass?.setScreen(video, video?.videoWidth, video?.videoHeight);
    this.drawnKey = "";
  });
  /** Counts what was to be seen so far, and says which of it the worker was given last. */
  private version = 0;
  private sortedVersion = 0;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    load: LoadSplats,
    private readonly xrCompatible = false,
  ) {
    this.files = new ArrivingFiles(load);
    this.pass = this.makePass();
    this.timer = this.pass && new DrawTimer(this.pass.gl, (tookMs) => this.onFinished(tookMs));
    this.worker.addEventListener("message", ({ data }: MessageEvent<Sorted>) => this.onSorted(data));
    this.canvas.addEventListener("webglcontextlost", () => {
      this.obstacle = "The graphics context of this device was lost";
      this.splats = null;
    });
  }

  get loaded(): boolean {
    return this.splats !== null;
  }

  /**
   * Who stands in the room; fetches whom it does not know yet. Who gets a better model meanwhile is
   * drawn by the one before until that has come. Throws a Problem.
   */
  async setPerformers(performers: readonly DrawnPerformer[]): Promise<void> {
    const before = this.performers;
    const alike = (key: "id" | "model_id"): boolean =>
      performers.length === before.length && performers.every((one, at) => one[key] === before[at]?.[key]);
    if (!this.pass || (alike("id") && alike("model_id") && this.splats)) return;
    this.performers = performers;
    if (!alike("id")) {
      this.splats = null;
      this.poses = [];
    }
    try {
      const files = performers.map(({ model_id: id }) => this.files.get(id));
      const beginnings = await Promise.all(files.map(({ beginning }) => beginning));
      const partial = files.some((file) => file.partial);
      if (partial && this.performers === performers && !this.splats) this.assemble(beginnings, true);
      const whole = await Promise.all(files.map((file) => file.whole));
      if (this.performers === performers) this.assemble(whole, false);
    } catch (error) {
      if (this.performers === performers) this.performers = []; // to be asked for again
      throw error;
    }
  }

  /** These are drawn no longer: the room stands empty until the others are drawn anew. */
  drop(gone: readonly DrawnPerformer[]): void {
    const lost = this.performers.filter(({ id }) => gone.some((one) => one.id === id));
    if (lost.length === 0) return;
    for (const { model_id } of lost) this.files.forget(model_id);
    const rest = this.performers.filter((one) => !lost.includes(one));
    this.pass?.clear();
    if (this.camera) this.pass?.draw({ camera: this.camera, ...NOBODY });
    void this.setPerformers(rest).catch(() => undefined);
  }

  /** Where everybody is from now on; shown with the next picture. */
  setEnvironment(place: LoadedEnvironment): void {
    this.pass?.setEnvironment(place);
    this.drawnKey = "";
  }

  /** A screen that is shared now, each of its pictures with the next of the room; null: none. */
  setScreen(video: HTMLVideoElement | null): void {
    this.screen.set(video);
    this.drawnKey = "";
  }

  /** Where a shared screen hangs from now on. */
  placeScreen(place: ScreenPlace): void {
    this.pass?.placeScreen(place);
    this.drawnKey = "";
  }

  /** Another connection: what it sends has nothing to do with the numbers of the last one. */
  forgetPoses(): void {
    this.poses = [];
  }

  /** A pose from the server; old ones change nothing. */
  acceptPacket(bytes: ArrayBuffer): void {
    const pose = decodePose(bytes);
    if (pose) this.setPose(pose);
  }

  /** A pose of somebody; old ones change nothing. */
  setPose(pose: PosePacket): void {
    if (!this.splats) return;
    const performer = this.performers[pose.index];
    if (pose.count !== this.performers.length || !performer || performerCheck(performer.id) !== pose.check) {
      this.onUnknownPerformers();
      return;
    }
    const last = this.poses[pose.index];
    if (last && !isNewer(pose.sequence, last.sequence)) return;
    this.poses[pose.index] = pose;
    this.lastPoseMs = performance.now();
    this.posesChanged = true;
  }

  /** Whether poses of everybody are coming. */
  get drawable(): boolean {
    if (!this.splats || performance.now() - this.lastPoseMs > STALE_MS) return false;
    return this.performers.every((_, index) => this.poses[index] !== undefined);
  }

  /**
   * Draw what has changed since the last time, each person's level of `kept` splats; says whether a
   * picture was drawn.
   */
  draw(view: CameraPose, fovYRad: number, { width, height }: Size, hideUnseen: boolean, kept: readonly number[]): boolean {
    const { splats, pass } = this;
    if (!splats || !pass || !this.drawable) return false;
    if (this.posesChanged) this.updateTransforms(splats);
    const camera = passCamera(view, fovYRad, width, height);
    const key = [...camera.worldToCamera, width, height, hideUnseen, ...kept].join();
    const changed = this.posesChanged || key !== this.drawnKey;
    this.posesChanged = false;
    this.drawnKey = key;
    if (changed) this.version += 1;
    this.sort(splats, camera, kept);
    const sorted = this.sorted;
    if (!sorted || !(changed || this.resorted)) return false;
    this.resorted = false;
    const startMs = performance.now();
    this.camera = camera;
    pass.draw({ camera, ...this.passPeople(splats, sorted, hideUnseen) });
    this.timer?.submitted(startMs);
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

  /** Everybody's splats; nobody's before they are here. */
  get people(): readonly SplatFile[] {
    return this.splats?.people ?? [];
  }

  /** The place of whom the server means by `check` (`performerCheck`); -1: nobody here. */
  indexOf(check: number): number {
    return this.performers.findIndex(({ id }) => performerCheck(id) === check);
  }

  /** What live look changes of everybody's splats from now on, see `SplatPass.setChanges`. */
  setChanges(changes: Uint32Array, laid: readonly (LaidPicture | null)[]): void {
    this.pass?.setChanges(changes, laid);
    this.drawnKey = "";
  }

  /** Splats of each person on the finest level; none before they are here. */
  get counts(): readonly number[] {
    return this.splats?.people.map(finest) ?? [];
  }

  /** Where everybody's pelvis is, m; at their place until they move. */
  get pelvisPositions(): readonly (readonly [number, number, number])[] {
    return this.performers.map((performer, index) => this.poses[index]?.pelvis ?? performer.position);
  }

  /**
   * Draw the room into both eyes of a headset, whether or not anything changed: what is not drawn
   * there is black. Each person's level of `kept` splats is drawn, sorted once, for `head`. Says
   * whether people are in the picture.
   */
  drawEyes(eyes: readonly Eye[], head: PassCamera, hideUnseen: boolean, kept: readonly number[]): boolean {
    const { splats, pass } = this;
    if (!pass) return false;
    const drawable = splats !== null && this.drawable;
    if (splats && drawable) {
      if (this.posesChanged) this.updateTransforms(splats);
      this.posesChanged = false;
      this.version += 1;
      this.sort(splats, head, kept);
    }
    const sorted = drawable ? this.sorted : null;
    pass.drawEyes(splats && sorted ? this.passPeople(splats, sorted, hideUnseen) : NOBODY, eyes);
    return sorted !== null;
  }

  /**
   * Pictures of `size` that this device draws a second, with `kept` splats of each person:
   * a short trial, which ends as soon as it is clear that `enough` will not be reached.
   */
  trialFps(view: CameraPose, fovYRad: number, { width, height }: Size, kept: readonly number[], enough: number): number {
    const { splats, pass } = this;
    if (!splats || !pass) return 0;
    // as they stand, where that is known: the last picture of a trial may be seen
    this.updateTransforms(splats, this.drawable ? undefined : (index) => this.performers[index]?.position);
    const camera = passCamera(view, fovYRad, width, height);
    const depth = new Float32Array(splats.count);
    const order = allocateOrder(splats.count);
    depths(displaced(splats.skinned, this.offsets), depthRows(this.transforms, camera.worldToCamera), depth, kept);
    const count = depthOrder(depth, order);
    const picture = (): number => {
      pass.draw({ camera, ...this.passPeople(splats, { order, count, kept }, false) });
      pass.read(1); // waits for the card
      return performance.now();
    };
    const startMs = picture(); // the first one also makes the shaders ready
    const mostMs = (1000 * TRIAL_FRAMES) / enough;
    let frames = 0;
    let tookMs = 0;
    while (frames < TRIAL_FRAMES && tookMs <= mostMs) {
      tookMs = picture() - startMs;
      frames += 1;
    }
    return (1000 * frames) / Math.max(tookMs, 0.1);
  }

  close(): void {
    this.screen.stop();
    this.worker.terminate();
    this.pass?.close();
    this.canvas.remove();
  }

  private makePass(): SplatPass | null {
    try {
      return new SplatPass(this.canvas, this.xrCompatible);
    } catch {
      this.obstacle = "This browser can’t render people: it has no WebGL2";
      return null;
    }
  }

  /** Everybody's splats; null, and an obstacle, for files that another release wrote. */
  private readAll(files: readonly ArrayBuffer[], partial: boolean): SplatFile[] | null {
    try {
      return files.map((file) => readSplats(file, 1, partial));
    } catch {
      this.obstacle = SERVER_ONLY;
      return null;
    }
  }

  private assemble(given: readonly (ArrayBuffer | null)[], partial: boolean): void {
    const files = given.filter((file) => file !== null);
    this.obstacle = null;
    if (given.length === 0) this.obstacle = "Nobody is here yet";
    if (files.length < given.length) this.obstacle = SERVER_ONLY;
    if (this.obstacle !== null) return;
    const whole = this.readAll(files, partial);
    if (!whole) return;
    const share = shareWithin(whole.map(finest));
    const people = share < 1 ? files.map((file) => readSplats(file, share, partial)) : whole;
    const splats = packSplats(people);
    this.splats = splats;
    this.transforms = new Float32Array(TRANSFORM * splats.joints);
    this.offsets = allocateOffsets(splats.moved);
    this.appliedExpressions = "";
    this.sorted = null;
    this.spareOrder = allocateOrder(splats.count);
    this.pass?.setSplats(splats);
    this.splatsVersion += 1;
    this.worker.postMessage({ version: this.splatsVersion, skinned: splats.skinned } satisfies SortTask);
    this.onLoaded();
  }

  /** Transforms and shadows of everybody: as they stand, or at rest at the given places. */
  private updateTransforms(splats: PackedSplats, place?: (index: number) => readonly number[] | undefined): void {
    let at = 0;
    this.applyExpressions(splats);
    this.shadows = splats.people.flatMap((person, index) => {
      const [x = 0, y = 0, z = 0] = place?.(index) ?? [];
      const [px = 0, py = 0, pz = 0] = person.restJoints;
      const pelvis = place ? [x + px, y + py, z + pz] : (this.poses[index]?.pelvis ?? []);
      const turns = place ? restRotations(person.parents.length) : (this.poses[index]?.rotations ?? []);
      forwardKinematics(person, pelvis, turns, this.transforms, at);
      const shadows = contactShadows(person, this.transforms, at);
      at += TRANSFORM * person.parents.length;
      return shadows;
    });
  }

  /** Move the splats of faces and hands, where anybody's changed. */
  private applyExpressions(splats: PackedSplats): void {
    const shown = this.performers.map((_, index) => this.poses[index]?.expression ?? []);
    const key = shown.join(";");
    if (key === this.appliedExpressions) return;
    this.appliedExpressions = key;
    this.offsets = allocateOffsets(splats.moved); // another array: the card's is to be written anew
    let first = 0;
    for (const [index, { moved }] of splats.people.entries()) {
      moveSplats(moved, shown[index] ?? [], this.offsets, first);
      first += moved.splats.length;
    }
    this.worker.postMessage({ version: this.splatsVersion, offsets: this.offsets } satisfies SortTask);
  }

  /** Have the worker sort for the newest view, unless it is still at the last one. */
  private sort({ people }: PackedSplats, camera: PassCamera, most: readonly number[]): void {
    const order = this.spareOrder;
    if (!order || this.sortedVersion === this.version) return;
    this.spareOrder = null;
    this.sortedVersion = this.version;
    const rows = depthRows(this.transforms, camera.worldToCamera);
    const kept = withoutOwnHead(people, this.transforms, camera.eye, most);
    const task: SortTask = { version: this.splatsVersion, rows, order, kept };
    this.worker.postMessage(task, [order.buffer]);
  }

  private passPeople(splats: PackedSplats, { order, count, kept }: Omit<Sorted, "version">, hideUnseen: boolean): PassPeople {
    const { transforms, offsets, shadows } = this;
    const growth = growths(splats.people, kept);
    const yawsRad = this.performers.map((performer) => performer.yaw_rad);
    return { transforms, offsets, shadows, order, count, growth, yawsRad, hideUnseen };
  }

  private onSorted(sorted: Sorted): void {
    if (sorted.version !== this.splatsVersion) return;
    // two orders take turns: one is shown while the worker fills the other
    this.spareOrder = this.sorted?.order ?? allocateOrder(this.splats?.count ?? 0);
    this.sorted = sorted;
    this.resorted = true;
  }
}
