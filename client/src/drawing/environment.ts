/** The place that a meeting is held in, as the page draws it. */

import { NO_SERVER, problemOf } from "../api/problem";
import { decodePicture, type Place } from "../splats/room";
import type { Environment } from "../api/types";

/** The picture and the light of a place. `token` is a seat's: the host's own picture takes it. Throws a Problem. */
export async function loadEnvironment(
  { picture_url, light }: Environment,
  token: string,
  request: typeof fetch = (input, init) => fetch(input, init),
): Promise<Place> {
  if (picture_url === null) return { picture: null, light };
  const headers = { Authorization: `Bearer ${token}` };
  const response = await request(picture_url, { headers }).catch(() => {
    throw NO_SERVER;
  });
  if (!response.ok) throw problemOf(response.status, await response.text());
  return { picture: await decodePicture(await response.blob()), light };
}
