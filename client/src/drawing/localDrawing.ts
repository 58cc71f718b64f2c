/** What this device draws of a meeting by itself: the page's picture, or a headset's visit. */

import type { Api } from "../api/api";
import type { Size } from "../viewpoint/framing";
import type { Vec3 } from "../viewpoint/geometry";
import { loadEnvironment } from "./environment";
import { loadSplats } from "../api/splats";
import { LocalRoom } from "../splats/localRoom";
import type { Place } from "../splats/room";
import { WayChooser, type Choice, type Drawing } from "../splats/way";
import { drawLatencyCode } from "../transport/latencyCode";
import type { Meeting } from "../api/types";
import { FOV_Y_RAD, type CameraPose } from "../viewpoint/viewpoint";
import type { Visit } from "./visit";

/** From then on a server that sends pictures in place of poses will not do otherwise. */
const UNANSWERED_S = 4;
/** Who is here is asked at most so often when the server speaks of people we don't know. */
const STRANGERS_MS = 1000;

export interface DrawingNews {
  /** The server must hear what is wanted of it from now on; pictures follow as they come. */
  onSwitch(drawing: Drawing): void;
  /** Another picture is seen: what is measured from now on is another thing. */
  onSeen(): void;
  /** The server speaks of people whom the meeting's roster doesn't name. */
  onStrangers(): void;
  /** The view that a trial is to draw. */
  trialView(): { camera: CameraPose; size: Size };
}

export class LocalDrawing {
  /** Lies over the video while this device draws. */
  readonly canvas = document.createElement("canvas");
  /** The local picture is the one that is seen. */
  seen = false;
  /** A headset draws, in place of the page. */
  visit: Visit | null = null;
  /** Of the seat: opens people's files and the place's. */
  token = "";

  private readonly chooser = new WayChooser();
  /** The room as this device draws it; made when a viewer takes the picture over. */
  private room: LocalRoom | null = null;
  /** Where the meeting is held, and its name as soon as it is asked for. */
  private place: Place | null = null;
  private placeName = "";
  /** What shows a screen that is shared now. */
  private screen: HTMLVideoElement | null = null;
  /** Seconds in which poses were asked for and pictures came. */
  private unanswered = 0;
  private strangersMs = -Infinity;

  constructor(
    private readonly api: Api,
    private readonly meeting: Meeting,
    private readonly news: DrawingNews,
  ) {}

  /** Try, from now on, whether this device can draw the page's picture. */
  begin(): void {
    if (this.room) return;
    const room = this.makeRoom(this.canvas);
    room.onLoaded = () => {
      const { camera, size } = this.news.trialView();
      this.chooser.tried(room.trialFps(camera, FOV_Y_RAD, size));
      this.switchWay();
    };
    this.room = room;
    void this.fetchPeople();
  }

  /** Show the place of this name as soon as its picture is here. */
  async showPlace(name: string): Promise<void> {
    this.meeting.environment = name;
    if (name === this.placeName || this.token === "") return;
    this.placeName = name;
    try {
      const place = await loadEnvironment(await this.api.place(this.meeting.id), this.token);
      if (this.placeName !== name) return;
      this.place = place;
      this.room?.setPlace(place);
      this.visit?.room.setPlace(place);
      this.switchWay();
    } catch {
      // asked for again with the next roster
      if (this.placeName === name) this.placeName = "";
    }
  }

  /** Hang the screen that `video` shows in the room; null: none is shared. */
  showScreen(video: HTMLVideoElement | null): void {
    if (video === this.screen) return;
    this.screen = video;
    this.room?.setScreen(video);
    this.visit?.room.setScreen(video);
  }

  /** Who draws from now on; at once where everything is here that it takes. */
  choose(choice: Choice): void {
    this.chooser.choose(choice);
    this.switchWay();
    void this.fetchPeople();
  }

  /** Have a headset draw into `canvas` from now on, until `endVisit`. */
  beginVisit(canvas: HTMLCanvasElement, camera: CameraPose, size: Size): Visit {
    this.visit = { room: this.makeRoom(canvas, true), camera, fovYRad: FOV_Y_RAD, size };
    void this.fetchPeople();
    return this.visit;
  }

  endVisit(): void {
    this.visit?.room.close();
    this.visit = null;
  }

  /** Fetch whom the roster names, where this device may come to draw them. */
  async fetchPeople(): Promise<void> {
    if (this.token === "") return;
    void this.showPlace(this.meeting.environment);
    void this.visit?.room.setPerformers(this.meeting.performers).catch(() => undefined);
    if (this.chooser.choice === "server") return;
    // who can't be had now is asked for again with the next roster
    await this.room?.setPerformers(this.meeting.performers).catch(() => undefined);
    this.switchWay();
  }

  /** A pose from the server. */
  accept(packet: ArrayBuffer): void {
    (this.visit?.room ?? this.room)?.accept(packet);
  }

  /** Another connection: what it sends has nothing to do with the poses of the last one. */
  forgetPoses(): void {
    this.room?.forgetPoses();
    this.visit?.room.forgetPoses();
  }

  /** This device has what it takes, and is to draw. */
  get ready(): boolean {
    return this.visit !== null || (this.room?.loaded === true && this.place !== null && this.chooser.way === "local");
  }

  /** Nobody's poses come any more, or this device is not to draw: the server's picture is the one to see. */
  get idle(): boolean {
    return !this.ready || this.room?.drawable === false;
  }

  /** Draw what has changed, where this device is to; says whether a picture was drawn. */
  draw(camera: CameraPose, size: Size, filmedOnly: boolean): boolean {
    return this.ready && this.room?.draw(camera, FOV_Y_RAD, size, filmedOnly) === true;
  }

  /** Stamp the picture drawn just now with when it was captured; false: nobody knows when. */
  stamp(): boolean {
    const [gl, capturedMs] = [this.room?.graphics, this.room?.capturedMs];
    if (!gl || capturedMs === undefined || capturedMs === null) return false;
    drawLatencyCode(gl, this.canvas.height, capturedMs);
    return true;
  }

  /** Show this device's picture, or the server's. */
  see(local: boolean): void {
    if (this.seen === local) return;
    this.seen = local;
    this.unanswered = 0;
    this.canvas.classList.toggle("seen", local);
    this.news.onSeen();
    this.switchWay();
  }

  /** A second of the live meeting went by, in which the viewer saw so many pictures. */
  countSecond(fps: number): void {
    const asking = this.ready && !this.seen && fps > 0;
    this.unanswered = asking ? this.unanswered + 1 : 0;
    if (this.unanswered === UNANSWERED_S) this.switchWay();
  }

  /** Give way to the server where this device drew too few pictures in the last second. */
  keepUp(fps: number, smallest: boolean): void {
    this.chooser.observe(fps, smallest);
    if (!this.ready) this.switchWay();
  }

  /** Where the performer at this place of the roster has their pelvis, m; undefined where the server draws. */
  pelvisOf(index: number): Vec3 | undefined {
    return this.visit?.room.places[index] ?? (this.seen ? this.room?.places[index] : undefined);
  }

  close(): void {
    this.room?.close();
    this.endVisit();
  }

  private makeRoom(canvas: HTMLCanvasElement, xrCompatible = false): LocalRoom {
    const room = new LocalRoom(canvas, (modelId) => loadSplats(modelId, this.token), xrCompatible);
    if (this.place) room.setPlace(this.place);
    if (this.screen) room.setScreen(this.screen);
    room.onStrangers = () => {
      const nowMs = performance.now();
      if (nowMs - this.strangersMs < STRANGERS_MS) return;
      this.strangersMs = nowMs;
      this.news.onStrangers();
    };
    return room;
  }

  private switchWay(): void {
    const way = this.seen ? "local" : "server";
    const refused = this.unanswered >= UNANSWERED_S ? "This room is drawn by the server alone" : null;
    this.news.onSwitch({ choice: this.chooser.choice, way, obstacle: this.room?.obstacle ?? refused });
  }
}
