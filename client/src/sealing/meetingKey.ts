/**
 * The key of a sealed meeting: drawn by the page that opens it, carried behind the # of its link, which browsers send
 * to nobody. What is derived from it is told in services/live/sealed_packet.py.
 */

const KEY_BYTES = 16;
/** Of so many bytes in base64url (RFC 4648), without padding. */
const TEXT = /^[\w-]{22}$/;
const CODE_DIGITS = 12;

export class MeetingKey {
  private constructor(private readonly bytes: Uint8Array<ArrayBuffer>) {}

  static random(): MeetingKey {
    return new MeetingKey(crypto.getRandomValues(new Uint8Array(KEY_BYTES)));
  }

  /** The key that `text` tells; null where it tells none. */
  static read(text: string | null): MeetingKey | null {
    if (text === null || !TEXT.test(text)) return null;
    const binary = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
    return new MeetingKey(Uint8Array.from(binary, (one) => one.charCodeAt(0)));
  }

  /** As it is in a link. */
  get text(): string {
    return btoa(String.fromCharCode(...this.bytes)).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
  }

  /** Twelve digits that are the same for everybody in the meeting who has this key. */
  async code(meetingId: string): Promise<string> {
    const named = new TextEncoder().encode(`metanerf code 1 ${meetingId} `);
    const digest = await crypto.subtle.digest("SHA-256", Uint8Array.of(...named, ...this.bytes));
    const digits = (new DataView(digest).getBigUint64(0) % 10n ** BigInt(CODE_DIGITS)).toString().padStart(CODE_DIGITS, "0");
    return digits.match(/.{3}/g)!.join(" ");
  }

  /** What seals the motion of one performer over the connection of this salt. */
  async motionKey(salt: Uint8Array<ArrayBuffer>, meetingId: string, performerId: string): Promise<CryptoKey> {
    const base = await crypto.subtle.importKey("raw", this.bytes, "HKDF", false, ["deriveKey"]);
    const info = new TextEncoder().encode(`metanerf motion 1 ${meetingId} ${performerId}`);
    const how = { name: "HKDF", hash: "SHA-256", salt, info };
    return crypto.subtle.deriveKey(how, base, { name: "AES-GCM", length: 128 }, false, ["encrypt", "decrypt"]);
  }
}

/** `link`, whose fragment may hold a token, with the key in its fragment. */
export function linkWithKey(link: string, key: MeetingKey | null): string {
  if (!key) return link;
  const [address = "", fragment = ""] = link.split("#");
  return `${address}#${fragment ? `${fragment}&` : ""}key=${key.text}`;
}
