/** The live view of a meeting: connection, viewpoint and picture size, kept in step with the screen. */

import type { Api } from "../api/api";
import type { Vec3 } from "../viewpoint/geometry";
import { headAbove, pelvisAt } from "../viewpoint/head";
import { MIN_USABLE_FPS, SIDES } from "../viewpoint/framing";
import { LocalRendering } from "./localRendering";
import type { Channel } from "../motion/channel";
import type { Sealing } from "../sealing/sealing";
import { Pacer, StallDetector, decodePose, encodeView, type PosePacket } from "../transport/packets";
import { VideoAdaptation } from "../transport/videoAdaptation";
import { PictureSize } from "../transport/pictureSize";
import type { RenderSetting, RenderStatus } from "../splats/renderMode";
import { KeptPictures } from "../transport/keptPictures";
import { LatencyMeter } from "../transport/latencyCode";
import { Sway } from "../viewpoint/sway";
import type { Meeting, Performer, Seat } from "../api/types";
import { PerformerRoster } from "./performerRoster";
import { FOV_Y_RAD, Viewpoint, homeOrbit, type CameraPose } from "../viewpoint/viewpoint";
import { WhepConnection, type WhepStats } from "../transport/whep";
import { FrameCount } from "./frameCount";
import type { HeadsetView } from "./headsetView";
import { picturePatienceS, type LiveOptions, type LiveState, type LiveStats } from "./liveState";

/** Browsers show tiny black pictures before the first real one. */
const SMALLEST_PX = 16;
const ROSTER_S = 10;

export class LiveView {
  readonly video = document.createElement("video");
  readonly viewpoint: Viewpoint;
  /** What there is of a sealed meeting's key; null: the meeting is not sealed. */
  readonly sealing: Sealing | null;
  onState: (state: LiveState) => void = () => undefined;
  onStats: (numbers: LiveStats) => void = () => undefined;
  onPerformers: (performers: readonly Performer[]) => void = () => undefined;
  /** Somebody is shown no longer. */
  onGone: (gone: readonly Performer[]) => void = () => undefined;
  onRenderStatus: (drawing: RenderStatus) => void = () => undefined;
  /** Drift gently to and fro, for a picture that nobody steers. */
  swaying = false;
  state: LiveState = { kind: "connecting" };
  private hideUnseen = true;
  private poseWatcher: ((pose: PosePacket) => void) | null = null;

  private readonly connection: WhepConnection;
  private readonly adaptation = new VideoAdaptation();
  private readonly localRendering: LocalRendering;
  readonly roster: PerformerRoster;
  /** Of this connection. */
  readonly kept: KeptPictures;
  private readonly pacer = new Pacer();
  private readonly stalls = new StallDetector();
  private readonly latency: LatencyMeter | null;
  private readonly timers: ReturnType<typeof setInterval>[] = [];
  private readonly size: PictureSize;
  private viewpointUnsent = true;
  /** The connection stands; for the viewer it is live with its first picture. */
  private connected = false;
  /** The server has said that its first picture takes longer. */
  private firstStart = false;
  private sequence = 0;
  private lastTickMs = 0;
  private readonly sway = new Sway();
  private animationFrame = 0;
  private videoFrame = 0;
  private readonly frames = new FrameCount();

  constructor(
    readonly api: Api,
    readonly meeting: Meeting,
    private readonly options: LiveOptions,
  ) {
    this.sealing = options.sealing;
    this.viewpoint = new Viewpoint(homeOrbit(meeting.viewpoint, 1), options.inertia);
    this.latency = options.stamped ? new LatencyMeter(this.video) : null;
    this.video.autoplay = this.video.muted = this.video.playsInline = true;
    this.video.disablePictureInPicture = true;
    this.size = new PictureSize(this.video, options.pinned, () => this.measure());
    this.localRendering = new LocalRendering(api, meeting, {
      onModeChange: (drawing) => {
        this.viewpointUnsent = true;
        this.adaptation.resetPatience();
        this.onRenderStatus(drawing);
      },
      onShownChange: () => this.restartAdaptation(),
      onUnknownPerformers: () => void this.roster.refresh(),
      onPose: (packet) => {
        const pose = this.poseWatcher && decodePose(packet);
        if (pose) this.poseWatcher?.(pose);
      },
      aspect: () => this.size.aspect,
      trialView: () => ({ camera: this.viewpoint.camera, size: this.size.requested }),
    }, this.sealing?.motions); // prettier-ignore
    this.roster = new PerformerRoster(api, meeting, {
      token: () => (this.live ? this.localRendering.token : ""),
      onPerformers: (performers, viewpoint) => {
        this.viewpoint.setHome(homeOrbit(viewpoint, this.size.aspect));
        this.onPerformers(performers);
        void this.localRendering.loadPerformers();
      },
      onGone: (gone) => {
        this.localRendering.drop(gone);
        this.onGone(gone);
      },
      onEnvironment: (name) => void this.showEnvironment(name),
    });
    this.connection = new WhepConnection({
      dataOnly: this.sealing !== null,
      seat: (stale) => this.seat(stale),
      address: options.address,
      onState: (state) => {
        // a new connection knows nothing of the viewpoint yet
        this.viewpointUnsent = true;
        this.connected = state.kind === "live";
        this.adaptation.resetPatience();
        this.localRendering.forgetPoses();
        this.setState(this.connected ? this.stateWithoutPicture : state);
      },
      onStream: (stream) => {
        this.video.srcObject = stream;
        this.play();
      },
      onPose: (packet) => this.localRendering.acceptPose(packet),
      onLook: (packet) => this.localRendering.acceptLook(packet),
    });
    this.kept = new KeptPictures(this.connection);
  }

  start(): void {
    void this.connection.run();
    this.animationFrame = requestAnimationFrame((ms) => this.frame(ms));
    this.videoFrame = this.video.requestVideoFrameCallback(() => this.onVideoFrame());
    this.measure();
    this.size.follow();
    // timers run in hidden pages too, where animation frames do not: the seat must not be lost
    this.timers.push(setInterval(() => this.send(false), 450));
    this.timers.push(setInterval(() => void this.everySecond(), 1000));
    this.timers.push(setInterval(() => void this.roster.refresh(), ROSTER_S * 1000));
    addEventListener("pagehide", this.onPageHide);
  }

  /** Browsers pause a video that is moved to another place of the page. */
  play(): void {
    // refused only where even muted video may not start by itself; then a touch starts it
    this.video.play().catch(() => addEventListener("pointerdown", () => this.play(), { once: true }));
  }

  /** Come close to somebody, in front of them. */
  lookAt({ viewpoint }: Performer): void {
    this.viewpoint.goTo(homeOrbit(viewpoint, this.size.aspect));
  }

  /** Show only what was filmed of the people; what was never seen of them is a guess. */
  setHideUnseen(on: boolean): void {
    this.hideUnseen = on;
    this.viewpointUnsent = true;
  }

  /** Hand the picture over to a viewer: no more drifting, everybody in sight. */
  startInteractive(): void {
    this.swaying = false;
    this.measure();
    this.viewpoint.reset();
    this.play();
    this.localRendering.begin();
  }

  /** Lies over the video while this device draws. */
  get canvas(): HTMLCanvasElement {
    return this.localRendering.canvas;
  }

  /** The control connection is back, at the same gateway or `elsewhere`: so may be the picture. */
  retryNow(elsewhere: boolean): void {
    if (elsewhere) this.connection.reconnect();
    this.connection.retryNow();
  }

  /** Show the environment of this name as soon as its picture is here. */
  showEnvironment(name: string): Promise<void> {
    return this.localRendering.showEnvironment(name);
  }

  /** Hang the screen that `video` shows in the room, where this device draws it; null: none is shared. */
  showScreen(video: HTMLVideoElement | null): void {
    this.localRendering.showScreen(video);
  }

  /** Who draws from now on; at once where everything is here that it takes. */
  chooseRenderMode(choice: RenderSetting): void {
    this.localRendering.chooseMode(choice);
  }

  /** Have a headset draw into `canvas` from now on, until `endVisit`. */
  beginHeadset(canvas: HTMLCanvasElement): HeadsetView {
    this.viewpointUnsent = true;
    return this.localRendering.beginHeadset(canvas, this.viewpoint.camera, this.size.requested);
  }

  /** The headset drew a picture from where its visit says, with people in it or not yet. */
  headsetFrameDrawn(withPeople: boolean): void {
    this.send(true);
    this.localRendering.advancePoses();
    if (!withPeople) return;
    this.frames.drawn();
    this.onPicture();
  }

  endHeadset(): void {
    this.localRendering.endHeadset();
    this.viewpointUnsent = true;
    this.adaptation.resetPatience();
  }

  /** The viewer's head, for voices that come from somewhere. */
  get listener(): CameraPose {
    return this.localRendering.headsetView?.camera ?? this.viewpoint.camera;
  }

  /** Where a performer's head is, m: above the pelvis that this device draws, or their place. */
  headPosition(performerId: string): Vec3 | null {
    const index = this.meeting.performers.findIndex(({ id }) => id === performerId);
    const performer = this.meeting.performers[index];
    if (!performer) return null;
    return headAbove(this.localRendering.pelvisOf(index) ?? pelvisAt(performer.position));
  }

  /** How late the voices are heard of the performers who are heard now, ms: their lips wait as long. */
  setVoiceDelays(delaysMs: ReadonlyMap<string, number>): void {
    this.localRendering.voiceDelaysMs = delaysMs;
  }

  /** Have poses come, whoever draws, for a picture of one's own; null: no longer. */
  watchPoses(watcher: ((pose: PosePacket) => void) | null): void {
    this.poseWatcher = watcher;
    this.viewpointUnsent = true;
  }

  /** A channel that moves a performer of ours; null while there is no connection. */
  openMotionChannel(performerId: string): Channel | null {
    const channel = this.connection.openMotionChannel(performerId);
    return this.sealing ? this.sealing.channel(channel, performerId) : channel;
  }

  /** Send pictures of oneself; null: none. */
  setLookTrack(track: MediaStreamTrack | null): void {
    this.connection.setLookTrack(track);
  }

  close(): void {
    removeEventListener("pagehide", this.onPageHide);
    this.connection.close();
    cancelAnimationFrame(this.animationFrame);
    this.video.cancelVideoFrameCallback(this.videoFrame);
    this.size.close();
    this.timers.forEach(clearInterval);
    this.localRendering.close();
    this.video.srcObject = null;
    this.video.remove();
  }

  private readonly onPageHide = (): void => this.connection.close();

  /** Connected, and no picture is there yet. */
  private get stateWithoutPicture(): LiveState {
    if (this.sealing) return { kind: "live" }; // no picture comes, ever: this device draws
    return this.adaptation.audioOnly ? { kind: "audio-only" } : { kind: "preparing", firstStart: this.firstStart };
  }

  private setState(state: LiveState): void {
    this.state = state;
    this.onState(state);
  }

  private async seat(stale: boolean): Promise<Seat> {
    const seat = await this.options.seat(stale);
    this.firstStart = !seat.ready;
    this.localRendering.token = seat.token;
    this.roster.set(seat);
    return seat;
  }

  private frame(nowMs: number): void {
    this.animationFrame = requestAnimationFrame((ms) => this.frame(ms));
    const seconds = Math.max(0, (nowMs - this.lastTickMs) / 1000);
    this.lastTickMs = nowMs;
    if (this.swaying && this.options.inertia) this.viewpoint.turn(this.sway.step(seconds), 0);
    const moved = this.viewpoint.step(seconds);
    if (this.localRendering.headsetView) return;
    this.send(moved);
    this.localRendering.advancePoses();
    if (this.localRendering.draw(this.viewpoint.camera, this.size.requested, this.hideUnseen)) {
      this.frames.drawn();
      // the code goes into the picture, and is read from it as it is seen
      if (this.latency && this.localRendering.stampLatencyCode()) this.latency.look(this.canvas);
      this.localRendering.showLocal(true);
      this.onPicture();
    }
  }

  private send(moved: boolean): void {
    if (!this.pacer.due(performance.now(), moved || this.viewpointUnsent)) return;
    const { position, wxyz } = this.listener;
    const packet = encodeView({
      sequence: (this.sequence = (this.sequence + 1) >>> 0),
      captureTimeMs: performance.timeOrigin + performance.now(),
      position,
      wxyz,
      fovYRad: this.localRendering.headsetView?.fovYRad ?? FOV_Y_RAD,
      hideUnseen: this.hideUnseen,
      rendersLocally: this.localRendering.ready,
      posesToo: this.poseWatcher !== null,
      audioOnly: this.adaptation.audioOnly && !this.localRendering.headsetView,
      stalled: this.connected && !this.sealing && !this.adaptation.audioOnly && !document.hidden && this.stalls.stalled(performance.now()),
      ...(this.localRendering.headsetView?.size ?? this.size.requested),
    });
    // what could not be sent is still news at the next tick
    this.viewpointUnsent = !this.connection.send(packet);
  }

  private measure(): void {
    if (!this.size.measure()) return;
    this.roster.set(this.meeting);
    this.fit();
  }

  private fit(): void {
    this.size.fit(this.adaptation.side);
    this.viewpointUnsent = true;
  }

  private restartAdaptation(): void {
    this.adaptation.restart();
    this.fit();
  }

  private onVideoFrame(): void {
    if (this.video.videoWidth >= SMALLEST_PX) {
      // a last picture that was on its way when this device took over is not shown any more
      if (!this.localRendering.shown) {
        this.frames.shown();
        this.latency?.look(this.video);
      }
      if (this.localRendering.ready) this.stalls.pause();
      else this.stalls.shown(performance.now());
      if (this.localRendering.idle) this.localRendering.showLocal(false);
      this.onPicture();
    }
    this.videoFrame = this.video.requestVideoFrameCallback(() => this.onVideoFrame());
  }

  private onPicture(): void {
    // a stray picture does not end audio only: `judge` does, once enough come
    if (!this.connected || this.live) return;
    this.adaptation.settle();
    this.setState({ kind: "live" });
  }

  /** In the meeting, with pictures or by audio only. */
  private get live(): boolean {
    return this.state.kind === "live" || this.state.kind === "audio-only";
  }

  private async everySecond(): Promise<void> {
    const fps = this.frames.take();
    const numbers = await this.connection.stats();
    this.publishStats(fps, numbers);
    if (!this.connected || document.hidden) return this.adaptation.resetPatience(); // hidden pages show no pictures
    if (this.state.kind === "live") this.localRendering.observeSecond(fps);
    this.adapt(fps, numbers);
  }

  private publishStats(fps: number, { framesDecoded, roundTripMs }: WhepStats): void {
    const { videoWidth, videoHeight } = this.video;
    const drawn = this.localRendering.shown ? this.size.requested : { width: videoWidth, height: videoHeight };
    const { width, height } = this.localRendering.headsetView?.size ?? drawn;
    if (width >= SMALLEST_PX) {
      this.onStats({ fps, framesDecoded: framesDecoded + this.frames.drawnHere, width, height, roundTripMs });
    }
  }

  /** Ask for what the pictures of the last second say that can come. */
  private adapt(fps: number, { received, lost }: WhepStats): void {
    const { live } = this;
    const [pinned, visits] = [this.size.pinned !== null, this.localRendering.headsetView !== null];
    if (live && this.localRendering.shown && !visits) this.localRendering.observeSpeed(fps, pinned || this.adaptation.side === SIDES[0]);
    const { highest } = this.size;
    const { coarse } = this.localRendering;
    const patienceS = this.sealing ? Infinity : picturePatienceS(this.state, this.firstStart);
    const step = this.adaptation.observe({ fps, received, lost, live, adapts: !pinned && !visits, highest, coarse, patienceS });
    if (step === "reconnect") this.connection.reconnect();
    if (step === "request") {
      this.fit();
      if (!this.localRendering.ready) this.stalls.shown(performance.now());
    }
    if (this.adaptation.audioOnly !== (this.state.kind === "audio-only") && (this.adaptation.audioOnly || fps >= MIN_USABLE_FPS)) {
      this.setState(this.adaptation.audioOnly ? { kind: "audio-only" } : { kind: "live" });
    }
  }
}
