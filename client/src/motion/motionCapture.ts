/** From the camera to the meeting: poses go out; pictures stay here, but for live look's while it is on. */

import { Problem } from "../api/problem";
import { CAMERA_GONE, closeCamera, openCamera } from "../capture/record";
import { ExpressionDetector } from "../landmarks/expressions";
import { LandmarkDetector } from "../landmarks/detector";
import { eachFrame } from "../landmarks/frames";
import type { Landmarks } from "../landmarks/landmarks";
import { MotionChannel, type Channel } from "./channel";
import { withoutLook } from "./motionPacket";
import { PoseSolving } from "./solving";

/** Landmarks need no more. */
const CAMERA = { width: 640, height: 480 };
/** Nobody in the picture for so long: say so, but not for a single picture. */
const LOST_MS = 600;

export type Tracking =
  | "starting"
  /** Nobody is in the picture. */
  | "searching"
  /** Somebody is, but the meeting can't be reached just now. */
  | "disconnected"
  | "tracking";

export interface MotionCaptureHooks {
  onTracking(tracking: Tracking): void;
  onLandmarks(seen: Landmarks | null): void;
  /** It is over: the camera, the finder or the meeting refused. */
  onProblem(problem: Problem): void;
}

export class MotionCapture {
  readonly video = document.createElement("video");
  tracking: Tracking = "starting";
  private stream: MediaStream | null = null;
  private detector: LandmarkDetector | null = null;
  private expressions: ExpressionDetector | null = null;
  private readonly channel: MotionChannel;
  private solving: PoseSolving | null = null;
  private closed = false;
  private endFrames: () => void = () => undefined;
  private foundMs = 0;
  private onLook: ((picture: ImageBitmap) => void) | null = null;

  /** `open` gives a channel that drives our performer. */
  constructor(
    open: () => Channel | null,
    private readonly hooks: MotionCaptureHooks,
  ) {
    this.video.autoplay = this.video.muted = this.video.playsInline = true;
    this.channel = new MotionChannel(open, {
      onBody: (body) => this.solving?.solveFor(body),
      onRefused: (problem) => this.fail(problem),
    });
  }

  async start(): Promise<void> {
    this.hooks.onTracking(this.tracking);
    try {
      const stream = await openCamera(CAMERA);
      if (this.closed) return closeCamera(stream);
      this.stream = stream;
      stream.getVideoTracks()[0]?.addEventListener("ended", () => this.fail(CAMERA_GONE));
      this.video.srcObject = stream;
      await this.video.play();
    } catch (error) {
      return this.fail(error instanceof Problem ? error : CAMERA_GONE);
    }
    this.detector = new LandmarkDetector(() => createImageBitmap(this.video), {
      onFound: (seen, timeMs, look) => this.onFound(seen, timeMs, look),
      onFailed: (reason) => this.fail(new Problem("Motion capture failed", reason)),
    });
    this.solving = new PoseSolving({
      // live look may have gone off while it was solved
      onSolved: (packet, timeMs) => this.channel.send(this.onLook ? packet : withoutLook(packet), timeMs),
      onFailed: (reason) => this.fail(new Problem("Motion capture failed", reason)),
    });
    this.endFrames = eachFrame(this.video, (timeMs) => this.detector?.offer(timeMs));
  }

  /** What the camera sees, while it is on. */
  get camera(): MediaStream | null {
    return this.stream?.active ? this.stream : null;
  }

  /** Have whoever is in view cut out of each picture for `onLook`, after its landmarks went out; null: no longer. */
  setLook(onLook: ((picture: ImageBitmap) => void) | null): void {
    this.onLook = onLook;
    if (this.detector) this.detector.look = onLook !== null;
    if (!onLook) this.channel.endLook();
  }

  /** The camera goes off, and the performer is left to their recorded motion. */
  close(): void {
    this.closed = true;
    this.endFrames();
    this.detector?.close();
    this.expressions?.close();
    this.solving?.close();
    this.channel.close();
    closeCamera(this.stream);
    this.video.srcObject = null;
  }

  private onFound(seen: Landmarks | null, timeMs: number, look: ImageBitmap | null): void {
    this.hooks.onLandmarks(seen);
    if (seen) this.foundMs = timeMs;
    const expression = this.expressions?.at(timeMs) ?? null;
    const head = this.expressions?.head ?? null;
    const liveLook = this.onLook !== null;
    const sent = seen !== null && this.channel.ready() && this.solving?.offer({ seen, expression, head, timeMs, liveLook });
    if (look) (this.onLook ?? closePicture)(look);
    if (seen) this.offerExpressions(seen, timeMs);
    if (this.closed) return;
    if (sent) this.setTracking("tracking");
    else if (seen) this.setTracking("disconnected");
    else if (timeMs - this.foundMs > LOST_MS) this.setTracking("searching");
  }

  private offerExpressions(seen: Landmarks, timeMs: number): void {
    // only now, so that finding the body starts as soon as it can
    this.expressions ??= new ExpressionDetector(({ x, y, side }) => createImageBitmap(this.video, x, y, side, side));
    this.expressions.offer(seen, timeMs);
  }

  private setTracking(tracking: Tracking): void {
    if (tracking === this.tracking) return;
    this.tracking = tracking;
    this.hooks.onTracking(tracking);
  }

  private fail(problem: Problem): void {
    if (this.closed) return;
    this.close();
    this.hooks.onProblem(problem);
  }
}

/** Live look went off while it was drawn. */
function closePicture(picture: ImageBitmap): void {
  picture.close();
}
