/** What a live view is given, and what it tells of itself. */

import type { Seat } from "../api/types";
import type { Sealing } from "../sealing/sealing";
import type { WhepState } from "../transport/whep";

export interface LiveStats {
  fps: number;
  framesDecoded: number;
  width: number;
  height: number;
  roundTripMs: number | null;
}

export interface LiveOptions {
  /** A seat in the meeting; `stale` when the last one is no longer accepted. */
  seat(stale: boolean): Promise<Seat>;
  /** Where pictures are asked for; `lost`: the last connection was lost, or did not come about. */
  address(lost: boolean): Promise<string>;
  inertia: boolean;
  /** Null: the meeting is not sealed. */
  sealing: Sealing | null;
  /** A fixed square size, px, in place of the adaptive one: for measuring. */
  pinned: number | null;
  /** Whether pictures show when they were captured: for measuring, too. */
  stamped: boolean;
}

/** As the viewer sees it: connected is not enough, a picture must be there, unless there is audio only. */
export type LiveState = WhepState | { kind: "preparing"; firstStart: boolean } | { kind: "audio-only" };
