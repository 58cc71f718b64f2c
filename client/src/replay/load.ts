/** Fetches a recording: what everybody moved, said and wrote, and what draws them. */

import type { Api } from "../api/api";
import type { PosePacket } from "../transport/packets";
import type { RecordingInFull } from "../api/types";
import { readMotion, readRooms, readText, type RoomRecord, type Track } from "./tracks";

export interface LoadedRecording {
  recording: RecordingInFull;
  rooms: Track<RoomRecord>;
  /** By performer. */
  motions: Map<string, Track<PosePacket>>;
  /** By member. */
  chats: Map<string, Track<string>>;
  /** By member, Ogg Opus. */
  voices: Map<string, Blob>;
}

/** Throws a Problem. */
export async function loadRecording(api: Api, id: string): Promise<LoadedRecording> {
  const recording = await api.recording(id);
  const loaded: LoadedRecording = {
    recording,
    rooms: { times: [], items: [] },
    motions: new Map(),
    chats: new Map(),
    voices: new Map(),
  };
  await Promise.all(
    recording.tracks.map(async ({ name, url }) => {
      const [kind, who = ""] = name.split(":");
      if (kind === "voice") loaded.voices.set(who, await api.file(`/v1/recordings/${id}/voices/${who}.ogg`));
      else {
        const bytes = await (await api.file(url)).arrayBuffer();
        if (kind === "motion") loaded.motions.set(who, readMotion(bytes));
        else if (kind === "chat") loaded.chats.set(who, readText(bytes));
        else loaded.rooms = readRooms(bytes);
      }
    }),
  );
  return loaded;
}
