/** How well the network carries a meeting, from how long beats take to come back. */

import type { Connection } from "../api/types";

/** A median over so many beats; one slow beat is no bad network. */
const WINDOW = 5;
const FAIR_FROM_MS = 150;
const POOR_FROM_MS = 400;
/** Better again only below this share of what made it worse. */
const BETTER_SHARE = 0.7;
const RANK: Record<Connection, number> = { good: 0, fair: 1, poor: 2 };

export class NetworkQualityMeter {
  private roundTripsMs: number[] = [];
  private level: Connection | null = null;

  /** A beat took so long; the new level where it is another one, else null. */
  observe(roundTripMs: number): Connection | null {
    this.roundTripsMs = [...this.roundTripsMs, roundTripMs].slice(-WINDOW);
    if (this.roundTripsMs.length < WINDOW) return null;
    const median = [...this.roundTripsMs].sort((a, b) => a - b)[WINDOW >> 1] ?? 0;
    const next = this.level !== null && RANK[levelOf(median)] < RANK[this.level] ? levelOf(median / BETTER_SHARE) : levelOf(median);
    if (next === this.level) return null;
    this.level = next;
    return next;
  }

  /** A new connection starts a new measurement. */
  reset(): void {
    this.roundTripsMs = [];
    this.level = null;
  }
}

function levelOf(milliseconds: number): Connection {
  if (milliseconds >= POOR_FROM_MS) return "poor";
  return milliseconds >= FAIR_FROM_MS ? "fair" : "good";
}
