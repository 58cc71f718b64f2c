/** How much a new value counts in the running mean of what hardly changes; the server's twin is services/live/settling_mean.py. */

const [FIRST_S, LEARNT_S] = [1, 20];

export class Settling {
  private knownS = 0;

  /** Share of a value that comes `stepS` after the last one; the first counts whole. */
  share(stepS: number): number {
    const share = this.knownS > 0 ? Math.min(1, stepS / Math.min(Math.max(this.knownS, FIRST_S), LEARNT_S)) : 1;
    this.knownS += stepS;
    return share;
  }
}
