/** Files in one archive, stored as they are: recorded video does not shrink. */

import { zipSync } from "fflate";

export interface ZipEntry {
  name: string;
  blob: Blob;
}

/** The same files make the same bytes, so that an upload that was cut off can be gone on with. */
const MADE = new Date(1980, 0, 1);

/** ZIP (PKWARE's APPNOTE) of `entries`, under 4 GiB together. */
export async function zip(entries: readonly ZipEntry[]): Promise<Blob> {
  const read = async ({ name, blob }: ZipEntry): Promise<[string, Uint8Array]> => [name, new Uint8Array(await blob.arrayBuffer())];
  const files = Object.fromEntries(await Promise.all(entries.map(read)));
  return new Blob([zipSync(files, { level: 0, mtime: MADE })], { type: "application/zip" });
}
