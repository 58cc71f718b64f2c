/** Watches whether pictures come, and says what to ask for: a size, sound alone, another connection. */

import { SizeLadder } from "../viewpoint/framing";

/** What went on in a second. */
export interface Second {
  /** Pictures that were shown. */
  fps: number;
  /** The pictures' packets on this connection so far: those that came and those that did not. */
  received: number;
  lost: number;
  /** Pictures have been there on this connection, or are not wanted. */
  live: boolean;
  /** What is asked for may change. */
  adapts: boolean;
  /** The largest step that is worth asking for. */
  highest: number;
  /** With no picture for so long something is wrong. */
  patienceS: number;
}

/** `ask`: the server must hear what is wanted from now on; `renew`: this connection brings nothing. */
export type Step = "stay" | "ask" | "renew";

/** A line loses packets now and then; where it is too slow for what is sent, so many. */
const LOSING = 0.05;
/** Where hardly anything comes, it takes a while until a loss is noticed. */
const LOSING_S = 5;

export class PictureFlow {
  private ladder = new SizeLadder();
  private still = 0;
  private received = 0;
  private lost = 0;
  private lossless = Infinity;
  /** No picture has come since the connection was given up, or pictures were asked for again. */
  private barren = false;

  get side(): number {
    return this.ladder.side;
  }

  /** Sound alone is wanted. */
  get silent(): boolean {
    return this.ladder.silent;
  }

  /** Pictures may take their time from now on. */
  expect(): void {
    this.still = 0;
  }

  /** The next seconds say nothing: something has just begun. */
  settle(): void {
    this.ladder.settle();
  }

  /** Pictures come another way from now on: what is known of their sizes says nothing. */
  beginAnew(): void {
    if (this.silent) return;
    this.ladder = new SizeLadder();
    this.ladder.settle();
  }

  observe(second: Second): Step {
    const { fps, live, adapts, highest } = second;
    const losing = this.loses(second);
    this.still = fps > 0 ? 0 : this.still + 1;
    if (fps > 0) this.barren = false;
    if (this.silent) return this.wait(highest);
    const gone = this.still >= second.patienceS;
    if (!adapts) return gone ? this.renew() : "stay";
    // a line that loses packets is too slow: another connection would be no faster
    if (gone && !(live && losing)) return this.giveUp(losing);
    if (!live) return "stay";
    return this.ladder.observe(fps, highest, losing) ? "ask" : "stay";
  }

  private wait(highest: number): Step {
    this.still = 0;
    if (!this.ladder.observe(0, highest)) return "stay";
    if (this.barren) return "renew";
    this.barren = true;
    return "ask";
  }

  private renew(): Step {
    this.still = 0;
    this.barren = true;
    return "renew";
  }

  /** No picture comes: another connection may help, once; then there is sound alone. */
  private giveUp(tooSlow: boolean): Step {
    if (!tooSlow && !this.barren) return this.renew();
    this.still = 0;
    this.barren = true;
    this.ladder.silence();
    return "ask";
  }

  /** Whether the connection loses more than now and then. */
  private loses({ received, lost }: Second): boolean {
    // another connection counts from nothing
    if (received < this.received) this.received = this.lost = 0;
    const [came, gone] = [received - this.received, lost - this.lost];
    this.received = received;
    this.lost = lost;
    this.lossless = gone > LOSING * (came + gone) ? 0 : this.lossless + 1;
    return this.lossless < LOSING_S;
  }
}
