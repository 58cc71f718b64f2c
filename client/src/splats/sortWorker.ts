/** Sorts splats beside the page: first the splats of a cast, then one set of depth rows after another. */

import { depthOrder, depths, type SkinnedPoints } from "./sort";

/** What the page tells: a new cast, or where everybody is now as `depthRows` gives it. */
export type SortTask =
  | { version: number; skinned: SkinnedPoints }
  | { version: number; rows: Float32Array; order: Uint32Array<ArrayBuffer>; kept: readonly number[] };
/** The order of the splats of a cast, and how many of them are in front of the camera. */
export interface Sorted {
  version: number;
  order: Uint32Array<ArrayBuffer>;
  count: number;
  /** Splats of each person that are in it. */
  kept: readonly number[];
}

let bound: SkinnedPoints | null = null;
let depth = new Float32Array(0);

addEventListener("message", ({ data }: MessageEvent<SortTask>) => {
  if ("skinned" in data) {
    bound = data.skinned;
    depth = new Float32Array(bound.positions.length / 3);
    return;
  }
  if (!bound) return;
  const { version, rows, order, kept } = data;
  depths(bound, rows, depth, kept);
  const sorted: Sorted = { version, order, count: depthOrder(depth, order), kept };
  postMessage(sorted, { transfer: [data.order.buffer] });
});
