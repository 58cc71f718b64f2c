/** Sealed packets that another library made (tools/build_sealed_cases.py), and what tests need to take them apart. */

import sealed from "../../../tests/services/live/sealed.json";
import { MeetingKey } from "../../src/sealing/meetingKey";

export const CASES = sealed;
export const KEY = MeetingKey.read(sealed.key)!;

export function bytesOf(hex: string): ArrayBuffer {
  return Uint8Array.from(hex.match(/../g) ?? [], (byte) => parseInt(byte, 16)).buffer;
}

export function hexOf(bytes: ArrayBuffer): string {
  return [...new Uint8Array(bytes)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** The same bytes but for one bit. */
export function flipped(packet: ArrayBuffer, bit: number): ArrayBuffer {
  const other = new Uint8Array(packet.slice(0));
  other[bit >> 3]! ^= 1 << (bit & 7);
  return other.buffer;
}
