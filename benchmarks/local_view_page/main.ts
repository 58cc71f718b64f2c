/** The page's own drawing as fast as it comes: poses and viewpoint anew for each picture. */

import { loadSplats } from "../../client/src/api/splats";
import { LocalRoom } from "../../client/src/splats/localRoom";
import { PacedRoom } from "../../client/src/splats/pacedRoom";
import { Recolouring } from "../../client/src/recolouring/recolouring";
import type { Performer } from "../../client/src/api/types";
import { FOV_Y_RAD, orbitCamera, type Orbit } from "../../client/src/viewpoint/viewpoint";

interface Asked {
  /** The file of everybody's model, base64. */
  file: string;
  /** Pose packets of one person each, base64: all people of a moment, moment by moment. */
  moments: string[][];
  size: number;
  seconds: number;
}

interface AskedLook extends Asked {
  /** Frame and pose of each person's pictures in turn, base64; none: without live look. */
  looks: [string, string][];
  looksPerSecond: number;
}

const bytes = (text: string): ArrayBuffer => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const TURN_RAD = 0.05;
/** Given the room that is measured; returns what is called before each picture, and says whether it counts. */
type OnRoom = (room: LocalRoom) => (nowMs: number) => boolean;

function performersOf(moments: string[][], modelId = ""): Performer[] {
  return (moments[0] ?? []).map((_, id) => ({
    id: `${id}`, name: "", model_id: modelId, motion_sequence_id: null, position: [0, 0, 0] as const, yaw_rad: 0,
  }));
}

async function measure({ file, moments, size, seconds }: Asked, onRoom: OnRoom = () => () => true): Promise<number> {
  const canvas = document.body.appendChild(document.createElement("canvas"));
  const room = new LocalRoom(canvas, () => Promise.resolve(bytes(file)));
  await room.setPerformers(performersOf(moments));
  const packets = moments.map((moment) => moment.map(bytes));
  const onPicture = onRoom(room);
  let pictures = 0;
  let drawn = 0;
  let endMs = Infinity;
  await new Promise<void>((resolve) => {
    const frame = (nowMs: number): void => {
      if (nowMs > endMs) return resolve();
      const counts = onPicture(nowMs);
      const moment = packets[drawn % packets.length] ?? [];
      moment.forEach((packet) => {
        new DataView(packet).setUint32(4, drawn + 1, true); // the newest counts
        room.acceptPacket(packet);
      });
      const orbit = { target: [0, 0.9, 0] as const, azimuthRad: TURN_RAD * drawn, elevationRad: 0.05, distanceM: 3.2 };
      if (room.draw(orbitCamera(orbit), FOV_Y_RAD, { width: size, height: size }, false, room.counts)) {
        drawn += 1;
        if (counts) {
          // what made the shaders ready is not counted
          if (pictures === 0) endMs = nowMs + 1000 * seconds;
          pictures += 1;
        }
      }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  });
  room.close();
  return pictures;
}

/** Pictures in so many seconds, and how often anybody's colours changed. */
async function measureLook(asked: AskedLook): Promise<[number, number]> {
  const people = asked.moments[0]?.length ?? 1;
  const looks = asked.looks.map(([frame, pose]) => [bytes(frame), bytes(pose)] as const);
  const each = looks.length / people;
  let changes = 0;
  let changesBefore: number | null = null;
  let recolouring: Recolouring | null = null;
  const pictures = await measure(asked, (room) => {
    const setChanges = room.setChanges.bind(room);
    room.setChanges = (all) => {
      changes += 1;
      setChanges(all);
    };
    const made = (recolouring = new Recolouring(() => room));
    let [told, startMs] = [0, performance.now()];
    return (nowMs) => {
      for (; looks.length > 0 && told < (asked.looksPerSecond * (nowMs - startMs)) / 1000; told++) {
        for (let person = 0; person < people; person++) {
          const [frame, pose] = looks[person * each + (told % each)] ?? looks[0]!;
          // the newest counts, by its number and by its moment
          for (const packet of [frame, pose]) new DataView(packet).setUint32(8, told, true);
          new DataView(pose).setFloat64(36, (1000 * told) / asked.looksPerSecond, true);
          made.accept(frame.slice(0), nowMs);
          made.accept(pose.slice(0), nowMs);
        }
      }
      if (looks.length === 0) return true;
      if (changesBefore === null && changes >= 2 * people) changesBefore = changes;
      return changesBefore !== null;
    };
  });
  (recolouring as Recolouring | null)?.close();
  return [pictures, changes - (changesBefore ?? 0)];
}

/** Fetches the model `modelId` as a meeting does; ms until the first picture of it is finished. */
async function firstPicture(modelId: string, moments: string[][], size: number): Promise<number> {
  const startMs = performance.now();
  const canvas = document.body.appendChild(document.createElement("canvas"));
  const room = new LocalRoom(canvas, (id, onBeginning) => loadSplats(id, "seat", undefined, onBeginning));
  const paced = new PacedRoom(room);
  const view = orbitCamera({ target: [0, 0.9, 0], azimuthRad: 0, elevationRad: 0.05, distanceM: 3.2 });
  const shape = { width: size, height: size };
  room.onLoaded = () => void paced.trial(view, FOV_Y_RAD, shape);
  void room.setPerformers(performersOf(moments, modelId));
  let sequence = 0;
  while (!paced.draw(view, FOV_Y_RAD, shape, false)) {
    await new Promise(requestAnimationFrame);
    sequence += 1;
    for (const packet of (moments[sequence % moments.length] ?? []).map(bytes)) {
      new DataView(packet).setUint32(4, sequence, true);
      room.acceptPacket(packet);
    }
  }
  room.graphics?.readPixels(0, 0, 1, 1, WebGL2RenderingContext.RGBA, WebGL2RenderingContext.UNSIGNED_BYTE, new Uint8Array(4));
  const tookMs = performance.now() - startMs;
  room.close();
  return tookMs;
}

interface Crowd extends Asked {
  orbit: Orbit;
  /** By the level of each that shows at their size and that the device draws in time; else all splats. */
  levels: boolean;
}

/** Pictures a second of everybody in a room, and the splats of each, once their number has settled. */
async function crowd({ file, moments, size, seconds, orbit, levels }: Crowd): Promise<{ rate: number; splats: readonly number[] }> {
  const room = new LocalRoom(document.body.appendChild(document.createElement("canvas")), () => Promise.resolve(bytes(file)));
  await room.setPerformers(performersOf(moments));
  const [paced, shape] = [new PacedRoom(room), { width: size, height: size }];
  paced.trial(orbitCamera(orbit), FOV_Y_RAD, shape);
  const draw = room.draw.bind(room);
  let splats = room.counts;
  room.draw = (view, fov, given, hide, kept) => draw(view, fov, given, hide, (splats = levels ? kept : room.counts));
  const packets = moments.map((moment) => moment.map(bytes));
  let [tick, pictures] = [0, 0];
  const until = async (endMs: number): Promise<void> => {
    for (pictures = 0; performance.now() < endMs; tick++) {
      for (const packet of packets[tick % packets.length] ?? []) {
        new DataView(packet).setUint32(4, tick + 1, true);
        room.acceptPacket(packet);
      }
      const view = orbitCamera({ ...orbit, azimuthRad: orbit.azimuthRad + 0.1 * Math.sin(TURN_RAD * tick) });
      if (paced.draw(view, FOV_Y_RAD, shape, false)) pictures += 1;
      await new Promise(requestAnimationFrame);
    }
  };
  await until(performance.now() + 1000 * seconds);
  await until(performance.now() + 1000 * seconds);
  room.close();
  return { rate: pictures / seconds, splats };
}

Object.assign(window, { measure: (asked: Asked) => measure(asked), measureLook, firstPicture, crowd });
