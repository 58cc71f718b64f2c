/** Files in one archive, stored as they are: recorded video does not shrink. */

export interface ZipEntry {
  /** ASCII. */
  name: string;
  blob: Blob;
}

const LOCAL = 0x04034b50;
const CENTRAL = 0x02014b50;
const END = 0x06054b50;
const VERSION = 20;
/** 1 January 1980: the same files make the same bytes, so that an upload that was cut off can be gone on with. */
const FIRST_DAY = (1 << 5) | 1;

/** ZIP (PKWARE's APPNOTE) of `entries`, under 4 GiB together. */
export async function zip(entries: readonly ZipEntry[]): Promise<Blob> {
  const parts: BlobPart[] = [];
  const directory: BlobPart[] = [];
  let [offset, directoryBytes] = [0, 0];
  for (const { name, blob } of entries) {
    const encoded = new TextEncoder().encode(name);
    const crc = crc32(new Uint8Array(await blob.arrayBuffer()));
    const about = [VERSION, 0, 0, 0, FIRST_DAY];
    const sizes = [crc, blob.size, blob.size];
    const local = header(LOCAL, about, sizes, [encoded.length, 0], []);
    const central = header(CENTRAL, [VERSION, ...about], sizes, [encoded.length, 0, 0, 0, 0], [0, offset]);
    parts.push(local, encoded, blob);
    directory.push(central, encoded);
    offset += local.byteLength + encoded.length + blob.size;
    directoryBytes += central.byteLength + encoded.length;
  }
  const end = header(END, [0, 0, entries.length, entries.length], [directoryBytes, offset], [0], []);
  return new Blob([...parts, ...directory, end], { type: "application/zip" });
}

/** A signature, then 2-byte, 4-byte, 2-byte and 4-byte numbers, little endian. */
function header(signature: number, shorts: number[], longs: number[], moreShorts: number[], moreLongs: number[]): ArrayBuffer {
  const fields = [
    ...[signature].map((value) => [value, 4] as const),
    ...shorts.map((value) => [value, 2] as const),
    ...longs.map((value) => [value, 4] as const),
    ...moreShorts.map((value) => [value, 2] as const),
    ...moreLongs.map((value) => [value, 4] as const),
  ];
  const data = new DataView(new ArrayBuffer(fields.reduce((sum, [, bytes]) => sum + bytes, 0)));
  let at = 0;
  for (const [value, bytes] of fields) {
    if (bytes === 2) data.setUint16(at, value, true);
    else data.setUint32(at, value, true);
    at += bytes;
  }
  return data.buffer;
}

const TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  let rest = byte;
  for (let bit = 0; bit < 8; bit++) rest = rest & 1 ? (rest >>> 1) ^ 0xedb88320 : rest >>> 1;
  return rest;
});

/** ISO 3309's, as ZIP asks for. */
function crc32(bytes: Uint8Array): number {
  let rest = 0xffffffff;
  for (const byte of bytes) rest = (rest >>> 8) ^ (TABLE[(rest ^ byte) & 0xff] ?? 0);
  return (rest ^ 0xffffffff) >>> 0;
}
