/** A capture's report on its clip, in plain words. */

import type { Sequence } from "../api/types";
import { saidToYou } from "./plainWords";

/** What the capture measured; every part may be missing. */
type Quality = Record<string, unknown>;

export interface QualityLine {
  label: string;
  value: string;
  level: "good" | "fair" | "poor";
}

const SIDES = ["front", "left", "back", "right"] as const;
/** A side seen in fewer than this share of the pictures is worth a word. */
const MIN_SIDE_SHARE = 0.08;
/** Bounds of good and of fair, for what the capture measures. */
const FRAMES = [30, 12] as const;
/** Share of the outline that the fitted body covers. */
const OVERLAP = [0.75, 0.6] as const;
/** Strength of the finest detail; a blurred picture has little. */
const DETAIL = [40, 20] as const;

export function qualityLines(sequence: Sequence): QualityLine[] {
  const quality = sequence.quality ?? {};
  const lines: QualityLine[] = [];
  const frames = number(quality["frames_used"]) ?? sequence.frames;
  if (frames !== null) lines.push(graded("Pictures used", frames, FRAMES));
  const sides = coverage(quality);
  if (sides) lines.push(sidesLine(sides));
  const overlap = number(quality["mask_overlap"]);
  if (overlap !== null) lines.push(graded("Outline", overlap, OVERLAP, ["Clear", "Fair", "Unclear"]));
  const detail = number(quality["blur"]);
  if (detail !== null) {
    lines.push(graded("Sharpness", detail, DETAIL, ["Sharp", "A little soft", "Blurred"]));
  }
  if (quality["legs_seen"] === false) {
    lines.push({ label: "Legs", value: "Not seen", level: "fair" });
  }
  return lines;
}

/** What to film again. */
export function advice(sequence: Sequence): string[] {
  const given = sequence.quality?.["advice"];
  return Array.isArray(given) ? given.filter((line): line is string => typeof line === "string").map(saidToYou) : [];
}

function sidesLine(sides: Record<string, number>): QualityLine {
  const seen = SIDES.filter((side) => (sides[side] ?? 0) >= MIN_SIDE_SHARE);
  const level = seen.length === 4 ? "good" : seen.length >= 2 ? "fair" : "poor";
  const value = seen.length === 4 ? "All round" : seen.length ? list(seen) : "None";
  return { label: "Sides seen", value, level };
}

function list(words: readonly string[]): string {
  const text = words.length < 2 ? words.join() : `${words.slice(0, -1).join(", ")} and ${words.at(-1)}`;
  return text.charAt(0).toUpperCase() + text.slice(1);
}

function graded(
  label: string,
  measured: number,
  [good, fair]: readonly [number, number],
  words?: readonly [string, string, string],
): QualityLine {
  const rank = measured >= good ? 0 : measured >= fair ? 1 : 2;
  const level = (["good", "fair", "poor"] as const)[rank];
  return { label, value: words?.[rank] ?? String(measured), level };
}

function coverage(quality: Quality): Record<string, number> | null {
  const sides = quality["coverage"];
  if (typeof sides !== "object" || sides === null) return null;
  const numbers = Object.entries(sides).filter(
    (entry): entry is [string, number] => typeof entry[1] === "number",
  );
  return Object.fromEntries(numbers);
}

function number(value: unknown): number | null {
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}
