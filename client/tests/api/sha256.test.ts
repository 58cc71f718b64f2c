import { describe, expect, it } from "vitest";
import { Sha256 } from "../../src/api/sha256";

function bytes(count: number): Uint8Array<ArrayBuffer> {
  return Uint8Array.from({ length: count }, (_, i) => (i * 167 + (i >> 8)) & 255);
}

async function byWebCrypto(data: Uint8Array<ArrayBuffer>): Promise<string> {
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", data));
  return [...digest].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

function inPieces(data: Uint8Array, piece: number): string {
  const hash = new Sha256();
  for (let at = 0; at < data.length; at += piece) hash.add(data.subarray(at, at + piece));
  return hash.hex();
}

describe("Sha256", () => {
  it("gives the digest of the standard's example", () => {
    const hash = new Sha256();
    hash.add(new TextEncoder().encode("abc"));
    expect(hash.hex()).toBe("ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  });

  it.each([0, 1, 55, 56, 57, 63, 64, 65, 119, 120, 128, 1000])("agrees with WebCrypto on %i bytes", async (count) => {
    const data = bytes(count);
    expect(inPieces(data, 1 << 20)).toBe(await byWebCrypto(data));
  });

  it.each([1, 7, 64, 100, 4096])("does not care for pieces of %i bytes", async (piece) => {
    const data = bytes(10_001);
    expect(inPieces(data, piece)).toBe(await byWebCrypto(data));
  });
});
