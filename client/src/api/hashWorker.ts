/** Hashes one clip beside the page, a piece at a time. */

import { Sha256 } from "./sha256";

/** The sha256 in hexadecimal; null where the clip could not be read to its end. */
export type Hashed = string | null;

const PIECE_BYTES = 4 << 20;

addEventListener("message", ({ data }: MessageEvent<Blob>) => {
  void hash(data).then(
    (hex) => tell(hex),
    () => tell(null),
  );
});

async function hash(clip: Blob): Promise<string> {
  const digest = new Sha256();
  for (let at = 0; at < clip.size; at += PIECE_BYTES) {
    digest.add(new Uint8Array(await clip.slice(at, at + PIECE_BYTES).arrayBuffer()));
  }
  return digest.hex();
}

function tell(hashed: Hashed): void {
  postMessage(hashed);
}
