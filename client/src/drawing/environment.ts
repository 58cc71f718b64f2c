/** The environment of a meeting, as the page draws it. */

import { NO_SERVER, problemOf } from "../api/problem";
import { decodePanorama, type LoadedEnvironment } from "../splats/room";
import type { Environment } from "../api/types";

/** The panorama and the lighting of an environment. `token` is a seat's: the host's own panorama needs it. Throws a Problem. */
export async function loadEnvironment(
  { picture_url, light }: Environment,
  token: string,
  request: typeof fetch = (input, init) => fetch(input, init),
): Promise<LoadedEnvironment> {
  if (picture_url === null) return { panorama: null, light };
  const headers = { Authorization: `Bearer ${token}` };
  const response = await request(picture_url, { headers }).catch(() => {
    throw NO_SERVER;
  });
  if (!response.ok) throw problemOf(response.status, await response.text());
  return { panorama: await decodePanorama(await response.blob()), light };
}
