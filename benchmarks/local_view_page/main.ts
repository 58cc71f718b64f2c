/** The page's own drawing as fast as it comes: poses and viewpoint anew for each picture. */

import { loadSplats } from "../../client/src/api/splats";
import { LocalRoom } from "../../client/src/splats/localRoom";
import { PacedRoom } from "../../client/src/splats/pacedRoom";
import type { Performer } from "../../client/src/api/types";
import { FOV_Y_RAD, orbitCamera } from "../../client/src/viewpoint/viewpoint";

interface Asked {
  /** The file of everybody's model, base64. */
  file: string;
  /** Pose packets of one person each, base64: all people of a moment, moment by moment. */
  moments: string[][];
  size: number;
  seconds: number;
}

const bytes = (text: string): ArrayBuffer => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const TURN_RAD = 0.05;


function performersOf(moments: string[][], modelId = ""): Performer[] {
  return (moments[0] ?? []).map((_, id) => ({
    id: `${id}`, name: "", model_id: modelId, motion_sequence_id: null, position: [0, 0, 0] as const, yaw_rad: 0,
  }));
}

async function measure({ file, moments, size, seconds }: Asked): Promise<number> {
  const canvas = document.body.appendChild(document.createElement("canvas"));
  const room = new LocalRoom(canvas, () => Promise.resolve(bytes(file)));
  await room.setPerformers(performersOf(moments));
  const packets = moments.map((moment) => moment.map(bytes));
  let pictures = 0;
  let endMs = Infinity;
  await new Promise<void>((resolve) => {
    const frame = (nowMs: number): void => {
      if (nowMs > endMs) return resolve();
      const moment = packets[pictures % packets.length] ?? [];
      moment.forEach((packet) => {
        new DataView(packet).setUint32(4, pictures + 1, true); // the newest counts
        room.acceptPacket(packet);
      });
      const orbit = { target: [0, 0.9, 0] as const, azimuthRad: TURN_RAD * pictures, elevationRad: 0.05, distanceM: 3.2 };
      if (room.draw(orbitCamera(orbit), FOV_Y_RAD, { width: size, height: size }, false, room.counts)) {
        // what made the shaders ready is not counted
        if (pictures === 0) endMs = nowMs + 1000 * seconds;
        pictures += 1;
      }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  });
  room.close();
  return pictures;
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

Object.assign(window, { measure, firstPicture });
