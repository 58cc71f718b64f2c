/** Motion without pictures: a keypoints file moves somebody who is here already. */

import type { Api } from "../api/api";
import { Problem } from "../api/problem";
import type { Meeting } from "../api/types";

/** Somebody with a model, which keypoints can animate. */
export interface AnimatablePerson {
  personId: string;
  name: string;
  modelId: string;
  /** Not whom the demo lends: what moves them is kept with them. */
  mine: boolean;
}

/** Why nobody new comes of a file of keypoints, and what does. */
export const MOTION_ONLY = new Problem(
  "This file contains motion only",
  "A new person needs a clip, because appearance comes from images. Use the “Keypoints” tab to animate an existing model with this file.",
);

const NO_KEYPOINTS = new Problem(
  "This file contains no keypoints",
  "Choose a JSON file in the metanerf-keypoints format. A clip of a new person goes under “Clip”.",
);
const HEAD_BYTES = 256;

/** Whether a file is JSON, as keypoints are and no clip is. */
export async function isJson(file: Blob): Promise<boolean> {
  const head = await file.slice(0, HEAD_BYTES).text();
  return /^\uFEFF?\s*[{[]/.test(head);
}

/** Everybody whom keypoints can move, each with their latest model, the latest first. */
export async function animatablePeople(api: Api): Promise<AnimatablePerson[]> {
  const [people, models] = await Promise.all([api.people(), api.models()]);
  const known = new Map(people.map((person) => [person.id, person]));
  const latest = new Map<string, AnimatablePerson>();
  // the oldest come first
  for (const { id, person_id: personId } of models) {
    latest.delete(personId);
    const person = known.get(personId);
    latest.set(personId, { personId, name: person?.name ?? "Somebody", modelId: id, mine: person?.mine ?? false });
  }
  return [...latest.values()].reverse();
}

/** A meeting of its own in which `somebody` moves as `file` says. Throws a Problem. */
export async function createKeypointsMeeting(
  api: Api,
  person: AnimatablePerson,
  file: File,
  signal: AbortSignal,
): Promise<Meeting> {
  // before it is sent: whatever else the file is, the server would take it for a clip of theirs
  if (!(await isJson(file))) throw NO_KEYPOINTS;
  const { modelId, name } = person;
  const hashed = await api.hashClip(file, file.name, signal);
  const personId = person.mine ? person.personId : (await api.createPerson({ name })).id;
  const sequence = await api.uploadSequence(personId, hashed, () => undefined, signal);
  const meeting = await api.createMeeting(`${name} by keypoints`, []);
  await api.addPerformer(meeting.id, modelId, sequence.id);
  return api.meeting(meeting.id);
}
