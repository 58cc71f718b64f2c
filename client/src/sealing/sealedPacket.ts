/**
 * Motion as it travels in a sealed meeting: 318 bytes that nobody reads without the meeting's key, and nobody changes,
 * sends again, or sends as somebody else's, without that being noticed. services/live/sealed_packet.py tells
 * what each byte holds; tests hold both to the same bytes, which another library made (tools/build_sealed_cases.py).
 */

import { MOTION_BYTES } from "../motion/motionPacket";
import type { MeetingKey } from "./meetingKey";

const VERSION = 1;
const KIND_SEALED_MOTION = 10;
const SALT_AT = 8;
const HEAD_BYTES = 24;
const TAG_BYTES = 16;
export const SEALED_BYTES = HEAD_BYTES + MOTION_BYTES + TAG_BYTES;
const MOST = 2 ** 32 - 1;

/** Seals the motion of one performer, for one connection: its salt is drawn anew, so that no nonce comes again. */
export class MotionSealer {
  private counter = 0;
  private readonly key: Promise<CryptoKey>;

  constructor(
    key: MeetingKey,
    meetingId: string,
    performerId: string,
    private readonly salt = crypto.getRandomValues(new Uint8Array(HEAD_BYTES - SALT_AT)),
  ) {
    this.key = key.motionKey(salt, meetingId, performerId);
  }

  /** Throws a RangeError for what is no motion packet, or one too many. */
  async seal(motion: ArrayBuffer): Promise<ArrayBuffer> {
    if (motion.byteLength !== MOTION_BYTES) throw new RangeError(`motion must be ${MOTION_BYTES} bytes long; got ${motion.byteLength}`);
    if (this.counter === MOST) throw new RangeError(`a connection must seal at most ${MOST} packets; got one more; open another`);
    this.counter += 1;
    const sealed = new Uint8Array(SEALED_BYTES);
    const data = new DataView(sealed.buffer);
    data.setUint8(0, VERSION);
    data.setUint8(1, KIND_SEALED_MOTION);
    data.setUint32(4, this.counter, true);
    sealed.set(this.salt, SALT_AT);
    const how = cipher(sealed.slice(0, HEAD_BYTES));
    sealed.set(new Uint8Array(await crypto.subtle.encrypt(how, await this.key, motion)), HEAD_BYTES);
    return sealed.buffer;
  }
}

/** `first`: of a connection that was not heard of before. */
export type Opened = { kind: "opened"; motion: ArrayBuffer; first: boolean } | { kind: "old" } | { kind: "refused" };

interface Connection {
  salt: string;
  key: CryptoKey;
  counter: number;
}

/** Opens the motion of one performer, each packet once, and none of a connection that another one followed. */
export class MotionOpener {
  private connection: Connection | null = null;
  private readonly ended = new Set<string>();

  constructor(
    private readonly key: MeetingKey,
    private readonly meetingId: string,
    private readonly performerId: string,
  ) {}

  async open(packet: ArrayBuffer): Promise<Opened> {
    const data = new DataView(packet);
    if (packet.byteLength !== SEALED_BYTES || data.getUint16(0) !== ((VERSION << 8) | KIND_SEALED_MOTION)) return { kind: "refused" };
    const salt = new Uint8Array(packet.slice(SALT_AT, HEAD_BYTES));
    const [named, counter] = [salt.join(), data.getUint32(4, true)];
    if (this.isOld(named, counter)) return { kind: "old" };
    const known = this.connection?.salt === named ? this.connection.key : null;
    const key = known ?? (await this.key.motionKey(salt, this.meetingId, this.performerId));
    const how = cipher(new Uint8Array(packet.slice(0, HEAD_BYTES)));
    const motion = await crypto.subtle.decrypt(how, key, packet.slice(HEAD_BYTES)).catch(() => null);
    if (!motion) return { kind: "refused" };
    // others may have been opened meanwhile
    if (this.isOld(named, counter)) return { kind: "old" };
    const first = this.connection?.salt !== named;
    if (first && this.connection) this.ended.add(this.connection.salt);
    this.connection = { salt: named, key, counter };
    return { kind: "opened", motion, first };
  }

  private isOld(salt: string, counter: number): boolean {
    return this.ended.has(salt) || (this.connection?.salt === salt && counter <= this.connection.counter);
  }
}

/** By the head that goes with it in the clear: the counter in it is the nonce, and all of it is authenticated. */
function cipher(head: Uint8Array<ArrayBuffer>): AesGcmParams {
  const nonce = new Uint8Array(12);
  nonce.set(head.subarray(4, SALT_AT));
  return { name: "AES-GCM", iv: nonce, additionalData: head, tagLength: 8 * TAG_BYTES };
}
