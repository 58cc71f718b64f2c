/** A recorded room on a canvas: everybody as they stood at a moment, seen from any side. */

import type { Api } from "../api/api";
import { ResolutionLadder, fitSize, highestStep, type Size } from "../viewpoint/framing";
import type { Vec3 } from "../viewpoint/geometry";
import { headAbove } from "../viewpoint/head";
import { performerCheck } from "../transport/packets";
import { LocalRoom, type DrawnPerformer } from "../splats/localRoom";
import { PacedRoom } from "../splats/pacedRoom";
import { decodePanorama, type LoadedEnvironment } from "../splats/room";
import type { Viewpoint as DefaultViewpoint } from "../api/types";
import { FOV_Y_RAD, Viewpoint, homeOrbit } from "../viewpoint/viewpoint";
import type { LoadedRecording } from "./load";
import type { Player } from "./player";
import { indexAt, poseAt, type RoomRecord } from "./tracks";

const COUNTING_MS = 1000;
/** In recordings that tell no viewpoint, everybody stands within a metre of the origin. */
const ROUND_THE_ORIGIN: DefaultViewpoint = { target: [0, 1.2, 0], azimuth_rad: 0, elevation_rad: 0.08, distance_m: 3, width_m: 3, depth_m: 1, narrow: null };

export class ReplayRenderer {
  readonly canvas = document.createElement("canvas");
  readonly viewpoint: Viewpoint;
  private readonly room: LocalRoom;
  private readonly pacedRoom: PacedRoom;
  private performers: DrawnPerformer[] = [];
  private home = ROUND_THE_ORIGIN;
  private environmentName = "";
  private sequence = 0;
  private readonly ladder = new ResolutionLadder();
  private drawn = 0;
  private countedMs = performance.now();
  /** Of the canvas, width by height. */
  private aspect = 1;

  constructor(
    private readonly api: Api,
    private readonly loaded: LoadedRecording,
    private readonly player: Player,
    inertia: boolean,
  ) {
    const { id } = loaded.recording;
    this.room = new LocalRoom(this.canvas, async (modelId) => {
      const file = await api.file(`/v1/recordings/${id}/models/${modelId}`);
      return file.arrayBuffer();
    });
    this.pacedRoom = new PacedRoom(this.room);
    this.room.onLoaded = () => void this.pacedRoom.trial(this.viewpoint.camera, FOV_Y_RAD, this.size);
    this.home = loaded.rooms.items[0]?.viewpoint ?? ROUND_THE_ORIGIN;
    this.viewpoint = new Viewpoint(homeOrbit(this.home, this.aspect), inertia);
    this.canvas.classList.add("shown");
  }

  /** Why this device can't draw the room, in words; null where it can. */
  get obstacle(): string | null {
    return this.room.obstacle;
  }

  /** Everybody's files are here. */
  get ready(): boolean {
    return this.room.loaded;
  }

  /** Show the moment that the player is at; says whether a picture was drawn. */
  draw(): boolean {
    const { ms } = this.player;
    const rooms = this.loaded.rooms;
    const room = rooms.items[Math.max(0, indexAt(rooms.times, ms))];
    if (room) this.showRoom(room);
    if (!this.ready) return false;
    this.performers.forEach((performer, index) => {
      const pose = poseAt(this.loaded.motions.get(performer.id), ms);
      if (!pose) return;
      this.sequence = (this.sequence + 1) >>> 0;
      const check = performerCheck(performer.id);
      this.room.setPose({ ...pose, sequence: this.sequence, index, count: this.performers.length, check });
    });
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.fit(width / Math.max(1, height));
    const drawn = this.pacedRoom.draw(this.viewpoint.camera, FOV_Y_RAD, this.size, false);
    if (drawn) this.adaptSize(highestStep(width * devicePixelRatio, height * devicePixelRatio));
    return drawn;
  }

  /** Where the head of whoever stood for a member is; null where nobody did. */
  headPosition(memberId: string): Vec3 | null {
    const rooms = this.loaded.rooms;
    const room = rooms.items[Math.max(0, indexAt(rooms.times, this.player.ms))];
    const pose = poseAt(this.loaded.motions.get(room?.standing_for[memberId] ?? ""), this.player.ms);
    if (!pose) return null;
    return headAbove(pose.pelvis);
  }

  close(): void {
    this.room.close();
  }

  private get size(): Size {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return fitSize(Math.max(16, width), Math.max(16, height), this.ladder.side);
  }

  /** Larger pictures where this device draws them fluently, smaller ones where it does not. */
  private adaptSize(highest: number): void {
    this.drawn += 1;
    const passedMs = performance.now() - this.countedMs;
    if (passedMs < COUNTING_MS) return;
    this.ladder.observe((this.drawn * 1000) / passedMs, highest, false, this.pacedRoom.coarse);
    this.drawn = 0;
    this.countedMs += passedMs;
  }

  /** Everybody in sight, however the window is shaped, until the viewer looks from elsewhere. */
  private fit(aspect: number): void {
    if (aspect === 0 || aspect === this.aspect) return;
    this.aspect = aspect;
    this.viewpoint.setHome(homeOrbit(this.home, aspect));
  }

  /** Whoever was erased since has no motion, and is not there. */
  private performersOf(room: RoomRecord): DrawnPerformer[] {
    return room.performers.filter(({ id }) => this.loaded.motions.has(id));
  }

  private showRoom(room: RoomRecord): void {
    const cast = this.performersOf(room);
    if (cast.map(({ id }) => id).join() !== this.performers.map(({ id }) => id).join()) {
      this.performers = cast;
      this.home = room.viewpoint ?? ROUND_THE_ORIGIN;
      this.viewpoint.setHome(homeOrbit(this.home, this.aspect));
      // who can't be had now is asked for again with the next change
      void this.room.setPerformers(cast).catch(() => undefined);
    }
    if (room.environment === this.environmentName) return;
    this.environmentName = room.environment;
    void this.showEnvironment(room.environment);
  }

  private async showEnvironment(name: string): Promise<void> {
    const place = await loadEnvironment(this.api, this.loaded.recording.id, name).catch(() => null);
    if (place && this.environmentName === name) this.room.setEnvironment(place);
  }
}

/** An environment of the library, else the panorama that the host had uploaded. Throws a Problem. */
export async function loadEnvironment(api: Pick<Api, "environments" | "recordedEnvironment" | "file">, recordingId: string, name: string): Promise<LoadedEnvironment> {
  const known = (await api.environments()).find((place) => place.name === name);
  const { picture_url, light } = known ?? (await api.recordedEnvironment(recordingId));
  return { panorama: picture_url === null ? null : await decodePanorama(await api.file(picture_url)), light };
}
