/** Sorts splats beside the page: first the splats of a cast, then one set of depth rows after another. */

import { depthOrder, depths, displaced, type SkinnedPoints } from "./sort";

/** What the page tells: a new cast, how its expressions move it, or where everybody is now as `depthRows` gives it. */
export type SortTask =
  | { version: number; skinned: SkinnedPoints }
  | { version: number; offsets: Float32Array }
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
let shown: SkinnedPoints | null = null;
let depth = new Float32Array(0);

addEventListener("message", ({ data }: MessageEvent<SortTask>) => {
  if ("skinned" in data) {
    bound = shown = data.skinned;
    depth = new Float32Array(bound.positions.length / 3);
    return;
  }
  if (!bound || !shown) return;
  if ("offsets" in data) {
    shown = displaced(bound, data.offsets);
    return;
  }
  const { version, rows, order, kept } = data;
  depths(shown, rows, depth, kept);
  const sorted: Sorted = { version, order, count: depthOrder(depth, order), kept };
  postMessage(sorted, { transfer: [data.order.buffer] });
});
