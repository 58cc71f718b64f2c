/** A training's report on how little of a model is enough, in plain words. */

import type { Model } from "../api/types";
import type { QualityLine } from "./quality";

/** One number of points that was tried. */
interface Tried {
  splats: number;
  good: boolean;
  /** Of body, face and hands. */
  lost_db: Record<string, number>;
}

/** As `metrics.size` of a model has it. */
interface Size {
  of: number;
  kept: number;
  tried: Tried[];
}

/** What was kept, what that cost and what was too little; nothing of a model that was not asked about. */
export function modelLines({ metrics }: Pick<Model, "metrics">): QualityLine[] {
  const size = metrics["size"];
  if (!isSize(size)) return [];
  const lines: QualityLine[] = [
    { label: "Points kept", value: `${count(size.kept)} of ${count(size.of)}`, level: "good" },
  ];
  const chosen = size.tried.find(({ splats }) => splats === size.kept);
  if (chosen) {
    const most = Math.max(0, ...Object.values(chosen.lost_db));
    lines.push({ label: "What that costs", value: `${most.toFixed(1)} dB at most`, level: "good" });
  }
  const tooFew = size.tried.filter(({ good }) => !good).map(({ splats }) => splats);
  if (tooFew.length) lines.push({ label: "Too few", value: count(Math.max(...tooFew)), level: "good" });
  return lines;
}

function count(points: number): string {
  return points.toLocaleString("en");
}

function isSize(found: unknown): found is Size {
  if (typeof found !== "object" || found === null) return false;
  const { of, kept, tried } = found as Partial<Size>;
  return typeof of === "number" && typeof kept === "number" && Array.isArray(tried);
}
