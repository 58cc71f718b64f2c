/** A look into a meeting: connection, viewpoint and picture size, kept in step with the screen. */

import type { Api } from "../api/api";
import type { Vec3 } from "../viewpoint/geometry";
import { FEW_FPS, SIDES } from "../viewpoint/framing";
import { LocalDrawing } from "./localDrawing";
import { Pacer, StallWatch, encodeView } from "../transport/packets";
import { PictureFlow } from "../transport/pictureFlow";
import { PictureSize } from "../transport/pictureSize";
import type { Choice, Drawing } from "../splats/way";
import { LatencyMeter } from "../transport/latencyCode";
import { Sway } from "../viewpoint/sway";
import type { Meeting, Performer, Seat } from "../api/types";
import { FOV_Y_RAD, Viewpoint, homeOrbit, type CameraPose } from "../viewpoint/viewpoint";
import { WhepLink, type LinkNumbers, type LinkState } from "../transport/whep";
import type { Visit } from "./visit";

export interface LiveNumbers {
  fps: number;
  framesDecoded: number;
  width: number;
  height: number;
  roundTripMs: number | null;
}

export interface LiveOptions {
  /** A seat in the meeting; `stale` when the last one is no longer accepted. */
  seat(stale: boolean): Promise<Seat>;
  inertia: boolean;
  /** A fixed square size, px, in place of the adaptive one: for measuring. */
  pinned: number | null;
  /** Whether pictures show when they were captured: for measuring, too. */
  stamped: boolean;
}

/** As the viewer sees it: connected is not enough, a picture must be there, unless there is sound alone. */
export type LiveState = LinkState | { kind: "preparing"; firstStart: boolean } | { kind: "sound" };

/** No picture for so long while the page is seen: the connection is dead, whatever it says. */
const STALLED_S = 4;
/** The very first picture may take longer: the server may have to load the people first. */
const PATIENCE_S = 20;
/** On its first start on a machine, the server compiles its renderer before the first picture. */
const FIRST_START_PATIENCE_S = 180;
/** Browsers show tiny black pictures before the first real one. */
const SMALLEST_PX = 16;
const ROSTER_S = 10;
/** Of somebody of usual height who stands. */
const PELVIS_M = 0.95;
const HEAD_ABOVE_PELVIS_M = 0.65;

export class LiveView {
  readonly video = document.createElement("video");
  readonly viewpoint: Viewpoint;
  onState: (state: LiveState) => void = () => undefined;
  onNumbers: (numbers: LiveNumbers) => void = () => undefined;
  onPerformers: (performers: readonly Performer[]) => void = () => undefined;
  onDrawing: (drawing: Drawing) => void = () => undefined;
  /** Drift gently to and fro, for a picture that nobody steers. */
  swaying = false;
  state: LiveState = { kind: "connecting" };
  private filmedOnly = false;

  private readonly link: WhepLink;
  private readonly flow = new PictureFlow();
  private readonly local: LocalDrawing;
  private readonly pacer = new Pacer();
  private readonly stalls = new StallWatch();
  private readonly latency: LatencyMeter | null;
  private readonly timers: ReturnType<typeof setInterval>[] = [];
  private readonly size: PictureSize;
  private resent = true;
  /** The connection stands; for the viewer it is live with its first picture. */
  private connected = false;
  /** The server has said that its first picture takes longer. */
  private firstStart = false;
  private sequence = 0;
  private shown = 0;
  private lastTickMs = 0;
  private readonly sway = new Sway();
  private tick = 0;
  private framing = 0;
  private drawn = 0;

  constructor(
    readonly api: Api,
    readonly meeting: Meeting,
    private readonly options: LiveOptions,
  ) {
    this.viewpoint = new Viewpoint(homeOrbit(meeting.performers, 1), options.inertia);
    this.latency = options.stamped ? new LatencyMeter(this.video) : null;
    this.video.autoplay = this.video.muted = this.video.playsInline = true;
    this.video.disablePictureInPicture = true;
    this.size = new PictureSize(this.video, options.pinned, () => this.measure());
    this.local = new LocalDrawing(api, meeting, {
      onSwitch: (drawing) => {
        this.resent = true;
        this.flow.expect();
        this.onDrawing(drawing);
      },
      onSeen: () => this.measureAnew(),
      onStrangers: () => void this.roster(),
      trialView: () => ({ camera: this.viewpoint.camera, size: this.size.now }),
    });
    this.link = new WhepLink({
      seat: (stale) => this.seat(stale),
      onState: (state) => {
        // a new connection knows nothing of the viewpoint yet
        this.resent = true;
        this.connected = state.kind === "live";
        this.flow.expect();
        this.local.forgetPoses();
        this.tell(this.connected ? this.waiting : state);
      },
      onStream: (stream) => {
        this.video.srcObject = stream;
        this.play();
      },
      onPose: (packet) => this.local.accept(packet),
    });
  }

  start(): void {
    void this.link.run();
    this.tick = requestAnimationFrame((ms) => this.frame(ms));
    this.framing = this.video.requestVideoFrameCallback(() => this.pictureShown());
    this.measure();
    this.size.follow();
    // timers run in hidden pages too, where animation frames do not: the seat must not be lost
    this.timers.push(setInterval(() => this.send(false), 450));
    this.timers.push(setInterval(() => void this.everySecond(), 1000));
    this.timers.push(setInterval(() => void this.roster(), ROSTER_S * 1000));
    addEventListener("pagehide", this.leavePage);
  }

  /** Browsers pause a video that is moved to another place of the page. */
  play(): void {
    // refused only where even muted video may not start by itself; then a touch starts it
    this.video.play().catch(() => addEventListener("pointerdown", () => this.play(), { once: true }));
  }

  /** Show only what was filmed of the people; what was never seen of them is a guess. */
  showFilmedOnly(on: boolean): void {
    this.filmedOnly = on;
    this.resent = true;
  }

  /** Hand the picture over to a viewer: no more drifting, everybody in sight. */
  takeOver(): void {
    this.swaying = false;
    this.measure();
    this.viewpoint.reset();
    this.play();
    this.local.begin();
  }

  /** Lies over the video while this device draws. */
  get canvas(): HTMLCanvasElement {
    return this.local.canvas;
  }

  /** The line to the others is back: so may be the picture. */
  hurry(): void {
    this.link.hurry();
  }

  /** Show the place of this name as soon as its picture is here. */
  showPlace(name: string): Promise<void> {
    return this.local.showPlace(name);
  }

  /** Hang the screen that `video` shows in the room, where this device draws it; null: none is shared. */
  showScreen(video: HTMLVideoElement | null): void {
    this.local.showScreen(video);
  }

  /** Who draws from now on; at once where everything is here that it takes. */
  choose(choice: Choice): void {
    this.local.choose(choice);
  }

  /** Have a headset draw into `canvas` from now on, until `endVisit`. */
  beginVisit(canvas: HTMLCanvasElement): Visit {
    this.resent = true;
    return this.local.beginVisit(canvas, this.viewpoint.camera, this.size.now);
  }

  /** The headset drew a picture from where its visit says, with people in it or not yet. */
  visited(withPeople: boolean): void {
    this.send(true);
    if (!withPeople) return;
    this.drawn += 1;
    this.shown += 1;
    this.alive();
  }

  endVisit(): void {
    this.local.endVisit();
    this.resent = true;
    this.flow.expect();
  }

  /** The viewer's head, for voices that come from somewhere. */
  get ears(): CameraPose {
    return this.local.visit?.camera ?? this.viewpoint.camera;
  }

  /** Where a performer's head is, m: above the pelvis that this device draws, or their place. */
  headOf(performerId: string): Vec3 | null {
    const index = this.meeting.performers.findIndex(({ id }) => id === performerId);
    const performer = this.meeting.performers[index];
    if (!performer) return null;
    const pelvis = this.local.pelvisOf(index);
    const [x, y, z] = pelvis ?? [performer.position[0], performer.position[1] + PELVIS_M, performer.position[2]];
    return [x, y + HEAD_ABOVE_PELVIS_M, z];
  }

  /** A channel that moves a performer of ours by keypoints; null while there is no connection. */
  drive(performerId: string): RTCDataChannel | null {
    return this.link.keypoints(performerId);
  }

  close(): void {
    removeEventListener("pagehide", this.leavePage);
    this.link.close();
    cancelAnimationFrame(this.tick);
    this.video.cancelVideoFrameCallback(this.framing);
    this.size.close();
    this.timers.forEach(clearInterval);
    this.local.close();
    this.video.srcObject = null;
    this.video.remove();
  }

  private readonly leavePage = (): void => this.link.close();

  /** Connected, and no picture is there yet. */
  private get waiting(): LiveState {
    return this.flow.silent ? { kind: "sound" } : { kind: "preparing", firstStart: this.firstStart };
  }

  private tell(state: LiveState): void {
    this.state = state;
    this.onState(state);
  }

  private async seat(stale: boolean): Promise<Seat> {
    const seat = await this.options.seat(stale);
    this.firstStart = !seat.ready;
    this.local.token = seat.token;
    this.showPerformers(seat.performers);
    return seat;
  }

  private showPerformers(performers: readonly Performer[]): void {
    this.viewpoint.rehome(homeOrbit(performers, this.size.aspect));
    this.meeting.performers = [...performers];
    this.onPerformers(performers);
    void this.local.fetchPeople();
  }

  private async roster(): Promise<void> {
    if (!this.live) return;
    // a roster that can't be had now is asked for again in a moment
    const meeting = await this.api.meeting(this.meeting.id).catch(() => null);
    if (!meeting) return;
    void this.showPlace(meeting.environment);
    this.showPerformers(meeting.performers);
  }

  private frame(nowMs: number): void {
    this.tick = requestAnimationFrame((ms) => this.frame(ms));
    const seconds = Math.max(0, (nowMs - this.lastTickMs) / 1000);
    this.lastTickMs = nowMs;
    if (this.swaying && this.options.inertia) this.viewpoint.turn(this.sway.step(seconds), 0);
    const moved = this.viewpoint.step(seconds);
    if (this.local.visit) return;
    this.send(moved);
    if (this.local.draw(this.viewpoint.camera, this.size.now, this.filmedOnly)) {
      this.drawn += 1;
      this.shown += 1;
      // the code goes into the picture, and is read from it as it is seen
      if (this.latency && this.local.stamp()) this.latency.look(this.canvas);
      this.local.see(true);
      this.alive();
    }
  }

  private send(moved: boolean): void {
    if (!this.pacer.due(performance.now(), moved || this.resent)) return;
    const { position, wxyz } = this.ears;
    const packet = encodeView({
      sequence: (this.sequence = (this.sequence + 1) >>> 0),
      captureTimeMs: performance.timeOrigin + performance.now(),
      position,
      wxyz,
      fovYRad: this.local.visit?.fovYRad ?? FOV_Y_RAD,
      hideUnseen: this.filmedOnly,
      drawsItself: this.local.ready,
      soundOnly: this.flow.silent && !this.local.visit,
      stalled: this.connected && !this.flow.silent && !document.hidden && this.stalls.stalled(performance.now()),
      ...(this.local.visit?.size ?? this.size.now),
    });
    // what could not be sent is still news at the next tick
    this.resent = !this.link.send(packet);
  }

  private measure(): void {
    if (!this.size.measure()) return;
    this.showPerformers(this.meeting.performers);
    this.fit();
  }

  private fit(): void {
    this.size.fit(this.flow.side);
    this.resent = true;
  }

  private measureAnew(): void {
    this.flow.beginAnew();
    this.fit();
  }

  private pictureShown(): void {
    if (this.video.videoWidth >= SMALLEST_PX) {
      // a last picture that was on its way when this device took over is not shown any more
      if (!this.local.seen) {
        this.shown += 1;
        this.latency?.look(this.video);
      }
      if (this.local.ready) this.stalls.rest();
      else this.stalls.shown(performance.now());
      if (this.local.idle) this.local.see(false);
      this.alive();
    }
    this.framing = this.video.requestVideoFrameCallback(() => this.pictureShown());
  }

  private alive(): void {
    // a stray picture does not end sound alone: `judge` does, once enough come
    if (!this.connected || this.live) return;
    this.flow.settle();
    this.tell({ kind: "live" });
  }

  /** In the meeting, with pictures or by sound alone. */
  private get live(): boolean {
    return this.state.kind === "live" || this.state.kind === "sound";
  }

  private get patienceS(): number {
    if (this.state.kind === "live") return STALLED_S;
    return this.firstStart ? FIRST_START_PATIENCE_S : PATIENCE_S;
  }

  private async everySecond(): Promise<void> {
    const fps = this.shown;
    this.shown = 0;
    const numbers = await this.link.numbers();
    this.showNumbers(fps, numbers);
    if (!this.connected || document.hidden) return this.flow.expect(); // hidden pages show no pictures
    if (this.state.kind === "live") this.local.countSecond(fps);
    this.judge(fps, numbers);
  }

  private showNumbers(fps: number, { framesDecoded, roundTripMs }: LinkNumbers): void {
    const { videoWidth, videoHeight } = this.video;
    const drawn = this.local.seen ? this.size.now : { width: videoWidth, height: videoHeight };
    const { width, height } = this.local.visit?.size ?? drawn;
    if (width >= SMALLEST_PX) {
      this.onNumbers({ fps, framesDecoded: framesDecoded + this.drawn, width, height, roundTripMs });
    }
  }

  /** Ask for what the pictures of the last second say that can come. */
  private judge(fps: number, { received, lost }: LinkNumbers): void {
    const { live } = this;
    const [pinned, visits] = [this.size.pinned !== null, this.local.visit !== null];
    if (live && this.local.seen && !visits) this.local.keepUp(fps, pinned || this.flow.side === SIDES[0]);
    const adapts = !pinned && !visits;
    const { highest } = this.size;
    const step = this.flow.observe({ fps, received, lost, live, adapts, highest, patienceS: this.patienceS });
    if (step === "renew") this.link.reconnect();
    if (step === "ask") {
      this.fit();
      if (!this.local.ready) this.stalls.shown(performance.now());
    }
    if (this.flow.silent !== (this.state.kind === "sound") && (this.flow.silent || fps >= FEW_FPS)) {
      this.tell(this.flow.silent ? { kind: "sound" } : { kind: "live" });
    }
  }
}
