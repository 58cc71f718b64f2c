/** A capture's report on its clip, in plain words. */

import type { Quality, Sequence } from "./types";

export interface QualityLine {
  label: string;
  value: string;
  level: "good" | "fair" | "poor";
}

const SIDES = ["front", "left", "back", "right"] as const;
/** A side seen in fewer than this share of the pictures is worth a word. */
const SEEN = 0.05;

export function qualityLines(sequence: Sequence): QualityLine[] {
  const quality = sequence.quality ?? {};
  const lines: QualityLine[] = [];
  const frames = number(quality, "frames_used") ?? sequence.frames;
  if (frames !== null) {
    const level = frames >= 30 ? "good" : frames >= 12 ? "fair" : "poor";
    lines.push({ label: "Pictures used", value: String(frames), level });
  }
  const sides = coverage(quality);
  if (sides) lines.push(sidesLine(sides));
  const agreement = number(quality, "agreement", "mask_pose_agreement", "mask_agreement");
  if (agreement !== null) {
    lines.push(graded("Outline", agreement, ["Clear", "Fair", "Unclear"], [0.8, 0.6]));
  }
  const sharpness = number(quality, "sharpness");
  if (sharpness !== null) {
    lines.push(graded("Sharpness", sharpness, ["Sharp", "A little soft", "Blurred"], [0.6, 0.3]));
  }
  const blur = number(quality, "blur", "blurred", "blurred_share");
  if (blur !== null) {
    lines.push(graded("Sharpness", 1 - blur, ["Sharp", "A little soft", "Blurred"], [0.8, 0.5]));
  }
  return lines;
}

/** What to film again, as the capture says it. */
export function advice(sequence: Sequence): string[] {
  const given = sequence.quality?.advice;
  return Array.isArray(given) ? given.filter((line): line is string => typeof line === "string") : [];
}

function sidesLine(sides: Record<string, number>): QualityLine {
  const seen = SIDES.filter((side) => (sides[side] ?? 0) >= SEEN);
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
  value: number,
  words: readonly [string, string, string],
  bounds: readonly [number, number],
): QualityLine {
  if (value >= bounds[0]) return { label, value: words[0], level: "good" };
  if (value >= bounds[1]) return { label, value: words[1], level: "fair" };
  return { label, value: words[2], level: "poor" };
}

function coverage(quality: Quality): Record<string, number> | null {
  const sides = quality["coverage"] ?? quality["sides"];
  if (typeof sides !== "object" || sides === null) return null;
  const numbers = Object.entries(sides).filter(
    (entry): entry is [string, number] => typeof entry[1] === "number",
  );
  return Object.fromEntries(numbers);
}

function number(quality: Quality, ...names: string[]): number | null {
  for (const name of names) {
    const value = quality[name];
    if (typeof value === "number" && Number.isFinite(value)) return value;
  }
  return null;
}
