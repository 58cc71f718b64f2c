/** Drifting gently to and fro, for a picture that nobody steers. */

const SWAY_RAD = 0.45;
const SWAY_S = 18;
const LONGEST_STEP_S = 0.1;

export class Sway {
  private seconds = 0;
  private turnedRad = 0;

  /** How far to turn further, rad, `seconds` after the last step. */
  step(seconds: number): number {
    this.seconds += Math.min(seconds, LONGEST_STEP_S);
    const wanted = SWAY_RAD * Math.sin((this.seconds * 2 * Math.PI) / SWAY_S);
    const turn = wanted - this.turnedRad;
    this.turnedRad = wanted;
    return turn;
  }
}
