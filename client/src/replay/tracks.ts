/** A recording's tracks as the server hands them out: records of u32 moment (ms), u16 length, bytes. */

import { decodePose, type PosePacket } from "../transport/packets";
import type { Viewpoint } from "../api/types";
import type { DrawnPerformer } from "../splats/localRoom";

export interface Track<Of> {
  /** Moments, ms, ascending. */
  times: number[];
  items: Of[];
}

/** What the recorder noted of the room. */
export interface RoomRecord {
  environment: string;
  performers: DrawnPerformer[];
  /** In front of everybody; recordings of before do not have it. */
  viewpoint?: Viewpoint;
  /** Participant -> who stood for them. */
  standing_for: Record<string, string>;
}

const HEAD_BYTES = 6;

/** The records in `bytes`, read by `read`; null leaves one out. Throws a RangeError where they break off. */
export function readTrack<Of>(bytes: ArrayBuffer, read: (data: ArrayBuffer) => Of | null): Track<Of> {
  const view = new DataView(bytes);
  const track: Track<Of> = { times: [], items: [] };
  for (let at = 0; at < bytes.byteLength; ) {
    const length = view.getUint16(at + 4, true);
    const end = at + HEAD_BYTES + length;
    if (end > bytes.byteLength) throw new RangeError(`a record must be whole; got ${bytes.byteLength - at} bytes`);
    const item = read(bytes.slice(at + HEAD_BYTES, end));
    if (item !== null) {
      track.times.push(view.getUint32(at, true));
      track.items.push(item);
    }
    at = end;
  }
  return track;
}

export const readMotion = (bytes: ArrayBuffer): Track<PosePacket> => readTrack(bytes, decodePose);
export const readText = (bytes: ArrayBuffer): Track<string> =>
  readTrack(bytes, (data) => new TextDecoder().decode(data));
export const readRooms = (bytes: ArrayBuffer): Track<RoomRecord> =>
  readTrack(bytes, (data) => JSON.parse(new TextDecoder().decode(data)) as RoomRecord);

/** Index of the last moment that is not after `ms`; -1 before the first. */
export function indexAt(times: readonly number[], ms: number): number {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((times[middle] ?? Infinity) <= ms) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/**
 * How somebody stood at `ms`: as they were last seen, since whoever left is none of the room's people.
 * Before their first moment as in that one; null where there is none.
 */
export function poseAt(motion: Track<PosePacket> | undefined, ms: number): PosePacket | null {
  return motion?.items[Math.max(0, indexAt(motion.times, ms))] ?? null;
}
