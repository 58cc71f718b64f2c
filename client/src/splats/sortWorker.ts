/** Sorts splats beside the page: first the splats of a cast, then one set of depth rows after another. */

import { depthOrder, depths, type Bound } from "./sort";

/** What the page tells: a new cast, or where everybody is now as `depthRows` gives it. */
export type SortTask = { cast: number; bound: Bound } | { cast: number; rows: Float32Array; order: Uint32Array<ArrayBuffer> };
/** The order of the splats of a cast, and how many of them are in front of the camera. */
export interface Sorted {
  cast: number;
  order: Uint32Array<ArrayBuffer>;
  count: number;
}

let bound: Bound | null = null;
let depth = new Float32Array(0);

addEventListener("message", ({ data }: MessageEvent<SortTask>) => {
  if ("bound" in data) {
    bound = data.bound;
    depth = new Float32Array(bound.positions.length / 3);
    return;
  }
  if (!bound) return;
  depths(bound, data.rows, depth);
  const sorted: Sorted = { cast: data.cast, order: data.order, count: depthOrder(depth, data.order) };
  postMessage(sorted, { transfer: [data.order.buffer] });
});
