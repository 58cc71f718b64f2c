/** The page's own drawing as fast as it comes: poses and viewpoint anew for each picture. */

import { LocalRoom } from "../../client/src/splats/localRoom";
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

async function measure({ file, moments, size, seconds }: Asked): Promise<number> {
  const canvas = document.body.appendChild(document.createElement("canvas"));
  const room = new LocalRoom(canvas, () => Promise.resolve(bytes(file)));
  const performers = (moments[0] ?? []).map((_, id) => ({
    id: `${id}`, name: "", model_id: "", motion_sequence_id: null, position: [0, 0, 0] as const, yaw_rad: 0,
  }));
  await room.setPerformers(performers);
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

Object.assign(window, { measure });
