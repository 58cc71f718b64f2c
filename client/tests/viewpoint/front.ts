import type { Performer, Viewpoint } from "../../src/api/types";

/** A first view, as the server tells of somebody at the origin who faces +z. */
export const FRONT: Viewpoint = { target: [0, 1.32, 0], azimuth_rad: 0, elevation_rad: 0.08, distance_m: 2.2, width_m: 0.9, depth_m: 0, narrow: null };

/** Somebody else's performer. */
export function performer(id: string, more: Partial<Performer> = {}): Performer {
  const plain = { id, name: id, model_id: `m-${id}`, motion_sequence_id: null, owner: "other", viewpoint: FRONT } as const;
  const drivable = more.owner === "own" || more.owner === "demo";
  return { ...plain, drivable, position: [0, 0, 0], yaw_rad: 0, ...more };
}
