/** What this device draws of a meeting by itself: the page's picture, or a headset's visit. */

import type { Api } from "../api/api";
import type { Size } from "../viewpoint/framing";
import type { Vec3 } from "../viewpoint/geometry";
import { loadEnvironment } from "./environment";
import { loadSplats } from "../api/splats";
import { LocalRoom } from "../splats/localRoom";
import { PacedRoom } from "../splats/pacedRoom";
import { screenPlace, type LoadedEnvironment } from "../splats/room";
import { Recolouring } from "../recolouring/recolouring";
import type { SealedMotions } from "../sealing/sealedMotions";
import { RenderModeSelector, type RenderSetting, type RenderStatus } from "../splats/renderMode";
import { drawLatencyCode } from "../transport/latencyCode";
import { poseHead } from "../transport/packets";
import type { Meeting, Performer } from "../api/types";
import { FOV_Y_RAD, fittedView, type CameraPose } from "../viewpoint/viewpoint";
import type { HeadsetView } from "./headsetView";
import { LipSync } from "./lipSync";

/** From then on a server that sends pictures in place of poses will not do otherwise. */
const UNANSWERED_S = 4;
/** Who is here is asked at most so often when the server speaks of people we don't know. */
const UNKNOWN_PERFORMERS_MS = 1000;

export interface LocalRenderingHooks {
  /** The server must hear what is wanted of it from now on; pictures follow as they come. */
  onModeChange(drawing: RenderStatus): void;
  /** Another picture is seen: what is measured from now on is another thing. */
  onShownChange(): void;
  /** The server speaks of people whom the meeting's roster doesn't name. */
  onUnknownPerformers(): void;
  /** A pose of somebody came, or of a sealed meeting, followed from what came. */
  onPose(packet: ArrayBuffer): void;
  /** The view that a trial is to draw. */
  trialView(): { camera: CameraPose; size: Size };
  /** Width over height of what is seen. */
  aspect(): number;
}

export class LocalRendering {
  /** Lies over the video while this device draws. */
  readonly canvas = document.createElement("canvas");
  /** The local picture is the one that is seen. */
  shown = false;
  /** A headset draws, in place of the page. */
  headsetView: HeadsetView | null = null;
  /** Of the seat: authorises the files of people and environment. */
  token = "";

  /** How late the voices of performers are heard that are heard now, ms. */
  voiceDelaysMs: ReadonlyMap<string, number> = new Map();

  private readonly recolouring = new Recolouring(() => this.headsetView?.room ?? this.room);
  private readonly lipSync = new LipSync(
    (index) => this.voiceDelaysMs.get(this.meeting.performers[index]?.id ?? "") ?? null,
    (packet) => (this.headsetView?.room ?? this.room)?.acceptPacket(packet),
    (check) => this.recolouring.behindMs(check),
  );
  private readonly modeSelector = new RenderModeSelector();
  /** The room as this device draws it; made when a viewer takes the picture over. */
  private room: LocalRoom | null = null;
  private pacedRoom: PacedRoom | null = null;
  /** Where the meeting is held, and its name as soon as it is asked for. */
  private environment: LoadedEnvironment | null = null;
  private environmentName = "";
  /** What shows a screen that is shared now. */
  private screen: HTMLVideoElement | null = null;
  /** Seconds in which poses were asked for and pictures came. */
  private unanswered = 0;
  private unknownPerformersMs = -Infinity;

  /** `motions`: of a sealed meeting, which this device alone can draw; else the server tells poses. */
  constructor(
    private readonly api: Api,
    private readonly meeting: Meeting,
    private readonly hooks: LocalRenderingHooks,
    private readonly motions?: SealedMotions,
  ) {
    if (motions) this.modeSelector.choose("local");
  }

  /** Try, from now on, whether this device can draw the page's picture. */
  begin(): void {
    if (this.room) return;
    const room = this.makeRoom(this.canvas);
    const pacedRoom = new PacedRoom(room, () => this.lipSync.finished(performance.now()));
    room.onLoaded = () => {
      const { camera, size } = this.hooks.trialView();
      this.modeSelector.setTrialFps(pacedRoom.trial(camera, FOV_Y_RAD, size));
      this.updateMode();
    };
    this.room = room;
    this.pacedRoom = pacedRoom;
    void this.loadPerformers();
  }

  /** Show the environment of this name as soon as its picture is here. */
  async showEnvironment(name: string): Promise<void> {
    this.meeting.environment = name;
    if (name === this.environmentName || this.token === "") return;
    this.environmentName = name;
    try {
      const place = await loadEnvironment(await this.api.environment(this.meeting.id), this.token);
      if (this.environmentName !== name) return;
      this.environment = place;
      this.room?.setEnvironment(place);
      this.headsetView?.room.setEnvironment(place);
      this.updateMode();
    } catch {
      // asked for again with the next roster
      if (this.environmentName === name) this.environmentName = "";
    }
  }

  /** Hang the screen that `video` shows in the room; null: none is shared. */
  showScreen(video: HTMLVideoElement | null): void {
    if (video === this.screen) return;
    this.screen = video;
    this.room?.setScreen(video);
    this.headsetView?.room.setScreen(video);
  }

  /** Who draws from now on; at once where everything is here that it takes. */
  chooseMode(choice: RenderSetting): void {
    this.modeSelector.choose(choice);
    this.updateMode();
    void this.loadPerformers();
  }

  /** Have a headset draw into `canvas` from now on, until `endVisit`. */
  beginHeadset(canvas: HTMLCanvasElement, camera: CameraPose, size: Size): HeadsetView {
    this.recolouring.forget();
    this.headsetView = { room: this.makeRoom(canvas, true), camera, fovYRad: FOV_Y_RAD, size };
    void this.loadPerformers();
    return this.headsetView;
  }

  endHeadset(): void {
    this.recolouring.forget();
    this.headsetView?.room.close();
    this.headsetView = null;
  }

  /** Fetch whom the roster names, where this device may come to draw them; a shared screen hangs behind them. */
  async loadPerformers(): Promise<void> {
    const screen = screenPlace(fittedView(this.meeting.viewpoint, this.hooks.aspect()));
    for (const room of [this.room, this.headsetView?.room]) room?.placeScreen(screen);
    if (this.token === "") return;
    void this.showEnvironment(this.meeting.environment);
    void this.headsetView?.room.setPerformers(this.meeting.performers).catch(() => undefined);
    if (this.modeSelector.setting === "server") return;
    // who can't be had now is asked for again with the next roster
    await this.room?.setPerformers(this.meeting.performers).catch(() => undefined);
    this.updateMode();
  }

  /** These are shown no longer: nothing of them stays on the picture, and their files are forgotten. */
  drop(gone: readonly Performer[]): void {
    for (const room of [this.room, this.headsetView?.room]) room?.drop(gone);
  }

  /** A packet of the channel `pose`. */
  acceptPose(packet: ArrayBuffer): void {
    if (this.motions) void this.motions.accept(packet, performance.now());
    else this.takePose(packet);
  }

  private takePose(packet: ArrayBuffer): void {
    this.hooks.onPose(packet);
    const head = poseHead(packet);
    if (head) this.recolouring.notePose(head.captureTimeMs, performance.now());
    this.lipSync.accept(packet, performance.now());
  }

  /** Of somebody's live look, from the server. */
  acceptLook(packet: ArrayBuffer): void {
    this.recolouring.accept(packet, performance.now());
  }

  /** Show the poses whose voices are heard by now. */
  advancePoses(): void {
    const people = (this.headsetView?.room ?? this.room)?.people ?? [];
    this.motions?.due(performance.now(), people.map(({ restJoints }) => restJoints)).forEach((packet) => this.takePose(packet));
    this.recolouring.update(performance.now());
    this.lipSync.advance(performance.now());
  }

  /** Another connection: what it sends has nothing to do with the poses of the last one. */
  forgetPoses(): void {
    this.lipSync.forget();
    this.recolouring.forget();
    this.room?.forgetPoses();
    this.headsetView?.room.forgetPoses();
  }

  /** This device has what it takes, and is to draw. */
  get ready(): boolean {
    return this.headsetView !== null || (this.room?.loaded === true && this.environment !== null && this.modeSelector.mode === "local");
  }

  /** Nobody's poses come any more, or this device is not to draw: the server's picture is the one to see. */
  get idle(): boolean {
    return !this.ready || this.room?.drawable === false;
  }

  /** Draw what has changed, where this device is to; says whether a picture was drawn. */
  draw(camera: CameraPose, size: Size, hideUnseen: boolean): boolean {
    const drawn = this.ready && this.pacedRoom?.draw(camera, FOV_Y_RAD, size, hideUnseen) === true;
    if (drawn) this.lipSync.submitted();
    return drawn;
  }

  /** Stamp the picture drawn just now with when it was captured; false: nobody knows when. */
  stampLatencyCode(): boolean {
    const [gl, capturedMs] = [this.room?.graphics, this.room?.capturedMs];
    if (!gl || capturedMs === undefined || capturedMs === null) return false;
    drawLatencyCode(gl, this.canvas.height, capturedMs);
    return true;
  }

  /** Show this device's picture, or the server's. */
  showLocal(local: boolean): void {
    if (this.shown === local) return;
    this.shown = local;
    this.unanswered = 0;
    this.canvas.classList.toggle("shown", local);
    this.hooks.onShownChange();
    this.updateMode();
  }

  /** A second of the live meeting went by, in which the viewer saw so many pictures. */
  observeSecond(fps: number): void {
    const asking = this.ready && !this.shown && fps > 0;
    this.unanswered = asking ? this.unanswered + 1 : 0;
    if (this.unanswered === UNANSWERED_S) this.updateMode();
  }

  /** This device draws people so coarsely that larger pictures are of no use. */
  get coarse(): boolean {
    return this.shown && this.pacedRoom?.coarse === true;
  }

  /** Give way to the server where this device drew too few pictures in the last second. */
  observeSpeed(fps: number, smallest: boolean): void {
    this.modeSelector.observe(fps, smallest && this.pacedRoom?.atSmallest === true);
    if (!this.ready) this.updateMode();
  }

  /** Where the performer at this place of the roster has their pelvis, m; undefined where the server draws. */
  pelvisOf(index: number): Vec3 | undefined {
    return this.headsetView?.room.pelvisPositions[index] ?? (this.shown ? this.room?.pelvisPositions[index] : undefined);
  }

  close(): void {
    this.endHeadset();
    this.recolouring.close();
    this.room?.close();
  }

  private makeRoom(canvas: HTMLCanvasElement, xrCompatible = false): LocalRoom {
    const room = new LocalRoom(canvas, (modelId, onBeginning) => loadSplats(modelId, this.token, undefined, onBeginning), xrCompatible);
    if (this.environment) room.setEnvironment(this.environment);
    if (this.screen) room.setScreen(this.screen);
    room.onUnknownPerformers = () => {
      const nowMs = performance.now();
      if (nowMs - this.unknownPerformersMs < UNKNOWN_PERFORMERS_MS) return;
      this.unknownPerformersMs = nowMs;
      this.hooks.onUnknownPerformers();
    };
    return room;
  }

  private updateMode(): void {
    const mode = this.shown ? "local" : "server";
    const refused = this.unanswered >= UNANSWERED_S ? "This server does not let pages render the room" : null;
    this.hooks.onModeChange({ setting: this.modeSelector.setting, mode, obstacle: this.room?.obstacle ?? refused });
  }
}
