/** A channel on which motion leaves sealed; what the server asks and answers about the body to solve is not secret. */

import type { Channel } from "../motion/channel";
import type { MotionSealer } from "./sealedPacket";

export class SealedChannel implements Channel {
  /** In order: each packet waits for the one before, or its counter would come too late. */
  private sent: Promise<void> = Promise.resolve();

  constructor(
    private readonly channel: Channel,
    private readonly sealer: MotionSealer,
  ) {}

  get binaryType(): BinaryType {
    return this.channel.binaryType;
  }

  set binaryType(type: BinaryType) {
    this.channel.binaryType = type;
  }

  get readyState(): RTCDataChannelState {
    return this.channel.readyState;
  }

  get bufferedAmount(): number {
    return this.channel.bufferedAmount;
  }

  get onmessage(): ((event: MessageEvent) => void) | null {
    return this.channel.onmessage;
  }

  set onmessage(listener: ((event: MessageEvent) => void) | null) {
    this.channel.onmessage = listener;
  }

  send(data: ArrayBuffer | string): void {
    if (typeof data === "string") return this.channel.send(data);
    const sealed = this.sealer.seal(data);
    this.sent = this.sent.then(async () => {
      const packet = await sealed;
      // it may have closed meanwhile
      if (this.channel.readyState === "open") this.channel.send(packet);
    });
  }

  close(): void {
    this.channel.close();
  }
}
