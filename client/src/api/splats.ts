/** Fetches the file from which a person is drawn: once, then it lies in the browser's cache for good. */

import { NO_SERVER, problemOf } from "./problem";

/** The server promises at most 5 MB; what claims to be more is not taken. */
const LARGEST_BYTES = 8_000_000;

/** So much of a larger file is drawn while the rest is on its way: the head, and the coarsest level. */
const BEGINNING_BYTES = 50_000;

/**
 * The file of a model, or null where the model has none that a page can draw; `onBeginning` is told
 * the first bytes of a large one. Throws a Problem.
 */
export async function loadSplats(
  modelId: string,
  token: string,
  request: typeof fetch = (input, init) => fetch(input, init),
  onBeginning: (bytes: ArrayBuffer) => void = () => undefined,
): Promise<ArrayBuffer | null> {
  const headers = { Authorization: `Bearer ${token}` };
  const response = await request(`/v1/models/${modelId}/files/viewer.splats`, { headers }).catch(() => {
    throw NO_SERVER;
  });
  // 404: a model that has been deleted meanwhile
  if (response.status === 204 || response.status === 404) return null;
  if (!response.ok) {
    throw problemOf(response.status, await response.text(), response.headers.get("Retry-After"));
  }
  if (Number(response.headers.get("Content-Length") ?? 0) > LARGEST_BYTES) {
    await response.body?.cancel();
    return null;
  }
  return response.body ? gather(response.body.getReader(), onBeginning) : null;
}

/** All that `reader` brings; null where that is too much. */
async function gather(
  reader: ReadableStreamDefaultReader<Uint8Array>,
  onBeginning: (bytes: ArrayBuffer) => void,
): Promise<ArrayBuffer | null> {
  const pieces: Uint8Array[] = [];
  let received = 0;
  for (let { done, value } = await next(reader); !done; { done, value } = await next(reader)) {
    if (!value) continue;
    pieces.push(value);
    const before = received;
    received += value.length;
    if (received > LARGEST_BYTES) {
      await reader.cancel();
      return null;
    }
    if (before < BEGINNING_BYTES && received >= BEGINNING_BYTES) onBeginning(joined(pieces, received));
  }
  return joined(pieces, received);
}

async function next(reader: ReadableStreamDefaultReader<Uint8Array>): Promise<{ done: boolean; value?: Uint8Array | undefined }> {
  return reader.read().catch(() => {
    throw NO_SERVER;
  });
}

function joined(pieces: readonly Uint8Array[], length: number): ArrayBuffer {
  const bytes = new Uint8Array(length);
  let at = 0;
  for (const piece of pieces) {
    bytes.set(piece, at);
    at += piece.length;
  }
  return bytes.buffer;
}
