/** Adapts the video to the connection: its size, audio only, or a new connection. */

import { ResolutionLadder } from "../viewpoint/framing";

/** What went on in a second. */
export interface SecondStats {
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
  /** What is drawn is so coarse that a larger picture is of no use. */
  coarse: boolean;
  /** With no picture for so long something is wrong. */
  patienceS: number;
}

/** `request`: the server must hear what is wanted from now on; `reconnect`: this connection brings nothing. */
export type AdaptationStep = "keep" | "request" | "reconnect";

/** A connection loses packets now and then; where it is too slow for what is sent, so many. */
const LOSSY_SHARE = 0.05;
/** Where hardly anything comes, it takes a while until a loss is noticed. */
const LOSSY_S = 5;

export class VideoAdaptation {
  private ladder = new ResolutionLadder();
  private secondsWithoutPicture = 0;
  private received = 0;
  private lost = 0;
  private secondsWithoutLoss = Infinity;
  /** No picture has come since the connection was given up, or pictures were asked for again. */
  private noPictureSinceRequest = false;

  get side(): number {
    return this.ladder.side;
  }

  /** Audio only is wanted. */
  get audioOnly(): boolean {
    return this.ladder.audioOnly;
  }

  /** Pictures may take their time from now on. */
  resetPatience(): void {
    this.secondsWithoutPicture = 0;
  }

  /** The next seconds say nothing: something has just begun. */
  settle(): void {
    this.ladder.settle();
  }

  /** Pictures come another way from now on: what is known of their sizes says nothing. */
  restart(): void {
    if (this.audioOnly) return;
    this.ladder = new ResolutionLadder();
    this.ladder.settle();
  }

  observe(second: SecondStats): AdaptationStep {
    const { fps, live, adapts, highest, coarse } = second;
    const lossy = this.isLossy(second);
    this.secondsWithoutPicture = fps > 0 ? 0 : this.secondsWithoutPicture + 1;
    if (fps > 0) this.noPictureSinceRequest = false;
    if (this.audioOnly) return this.observeAudioOnly(highest);
    const gone = this.secondsWithoutPicture >= second.patienceS;
    if (!adapts) return gone ? this.reconnect() : "keep";
    // a connection that loses packets is too slow: another connection would be no faster
    if (gone && !(live && lossy)) return this.giveUp(lossy);
    if (!live) return "keep";
    return this.ladder.observe(fps, highest, lossy, coarse) ? "request" : "keep";
  }

  private observeAudioOnly(highest: number): AdaptationStep {
    this.secondsWithoutPicture = 0;
    if (!this.ladder.observe(0, highest)) return "keep";
    if (this.noPictureSinceRequest) return "reconnect";
    this.noPictureSinceRequest = true;
    return "request";
  }

  private reconnect(): AdaptationStep {
    this.secondsWithoutPicture = 0;
    this.noPictureSinceRequest = true;
    return "reconnect";
  }

  /** No picture comes: another connection may help, once; then there is audio only. */
  private giveUp(tooSlow: boolean): AdaptationStep {
    if (!tooSlow && !this.noPictureSinceRequest) return this.reconnect();
    this.secondsWithoutPicture = 0;
    this.noPictureSinceRequest = true;
    this.ladder.dropToAudioOnly();
    return "request";
  }

  /** Whether the connection loses more than now and then. */
  private isLossy({ received, lost }: SecondStats): boolean {
    // another connection counts from nothing
    if (received < this.received) this.received = this.lost = 0;
    const [came, gone] = [received - this.received, lost - this.lost];
    this.received = received;
    this.lost = lost;
    this.secondsWithoutLoss = gone > LOSSY_SHARE * (came + gone) ? 0 : this.secondsWithoutLoss + 1;
    return this.secondsWithoutLoss < LOSSY_S;
  }
}
