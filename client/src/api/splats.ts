/** Fetches the file from which a person is drawn: once, then it lies in the browser's cache for good. */

import { NO_SERVER, problemOf } from "./problem";

/** The server promises at most 5 MB; what claims to be more is not taken. */
const LARGEST_BYTES = 8_000_000;

/** The file of a model, or null where the model has none that a page can draw. Throws a Problem. */
export async function loadSplats(
  modelId: string,
  token: string,
  request: typeof fetch = (input, init) => fetch(input, init),
): Promise<ArrayBuffer | null> {
  const headers = { Authorization: `Bearer ${token}` };
  const response = await request(`/v1/models/${modelId}/files/viewer.splats`, { headers }).catch(() => {
    throw NO_SERVER;
  });
  if (response.status === 404) return null;
  if (!response.ok) {
    throw problemOf(response.status, await response.text(), response.headers.get("Retry-After"));
  }
  if (Number(response.headers.get("Content-Length") ?? 0) > LARGEST_BYTES) {
    await response.body?.cancel();
    return null;
  }
  return response.arrayBuffer();
}
