import { describe, expect, it } from "vitest";
import { zip } from "../../src/capture/zip";

async function bytesOf(blob: Blob): Promise<Uint8Array> {
  return new Uint8Array(await blob.arrayBuffer());
}

describe("an archive of recordings", () => {
  const entries = [
    { name: "1-face.webm", blob: new Blob(["123456789"]) },
    { name: "2-turn_left.webm", blob: new Blob([""]) },
  ];

  it("lays out what it holds as ZIP says", async () => {
    const bytes = await bytesOf(await zip(entries));
    const data = new DataView(bytes.buffer);
    // the check value of CRC-32
    expect(data.getUint32(14, true)).toBe(0xcbf43926);
    expect([data.getUint32(18, true), data.getUint32(22, true)]).toEqual([9, 9]);
    expect(new TextDecoder().decode(bytes.slice(30, 50))).toBe("1-face.webm123456789");
    const end = bytes.length - 22;
    expect(data.getUint32(end, true)).toBe(0x06054b50);
    expect(data.getUint16(end + 10, true)).toBe(2);
    const [size, start] = [data.getUint32(end + 12, true), data.getUint32(end + 16, true)];
    expect(start + size).toBe(end);
    const second = start + 46 + "1-face.webm".length;
    expect(data.getUint32(second, true)).toBe(0x02014b50);
    expect(data.getUint32(second + 42, true)).toBe(50);
  });

  it("is the same bytes for the same recordings, whenever it is made", async () => {
    expect(await bytesOf(await zip(entries))).toEqual(await bytesOf(await zip(entries)));
  });
});
