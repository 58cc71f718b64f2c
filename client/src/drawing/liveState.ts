/** What a live view is given, and what it tells of itself. */

import type { Seat } from "../api/types";
import type { Sealing } from "../sealing/sealing";
import type { WhepState } from "../transport/whep";

/** No picture for so long while the page is seen: the connection is dead, whatever it says. */
const STALLED_S = 4;
/** The very first picture may take longer: the server may have to load the people first. */
const FIRST_PICTURE_TIMEOUT_S = 20;
/** On its first start on a machine, the server compiles its renderer before the first picture. */
const FIRST_START_TIMEOUT_S = 180;

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

/** How long a picture is waited for before the connection is made anew, s. */
export function picturePatienceS(state: LiveState, firstStart: boolean): number {
  if (state.kind === "live") return STALLED_S;
  return firstStart ? FIRST_START_TIMEOUT_S : FIRST_PICTURE_TIMEOUT_S;
}
