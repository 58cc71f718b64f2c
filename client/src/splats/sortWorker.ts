/** Sorts splats beside the page: first the splats of a cast, then one set of depth rows after another. */

import { depthOrder, depths, type Bound } from "./sort";

/** What the page tells: a new cast, or where everybody is now as `depthRows` gives it. */
export type SortTask =
  | { cast: number; bound: Bound }
  | { cast: number; rows: Float32Array; order: Uint32Array<ArrayBuffer>; kept: readonly number[] };
/** The order of the splats of a cast, and how many of them are in front of the camera. */
export interface Sorted {
  cast: number;
  order: Uint32Array<ArrayBuffer>;
  count: number;
  /** Splats of each person that are in it. */
  kept: readonly number[];
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
  const { cast, rows, order, kept } = data;
  depths(bound, rows, depth, kept);
  const sorted: Sorted = { cast, order, count: depthOrder(depth, order), kept };
  postMessage(sorted, { transfer: [data.order.buffer] });
});
