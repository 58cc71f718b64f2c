/** What the server says of a clip, said to whom the clip shows: it speaks of a person, we speak to them. */

import { Problem } from "../api/problem";

/** In this order: what is said of them whole before single words. */
const SAID: readonly (readonly [RegExp, string])[] = [
  [/\bfilm one person\b/gi, "film yourself alone"],
  [/\bkeep one person\b/gi, "stay alone"],
  [/\ba person; got nobody\b/gi, "you; got nobody"],
  [/\bthe person is\b/gi, "you are"],
  [/\bthe person was\b/gi, "you were"],
  [/\bthe person's\b/gi, "your"],
  [/\bthe person\b/gi, "you"],
];
const INVALID = 422;

export function saidToYou(text: string): string {
  const like = (before: string, after: string): string => (/^[A-Z]/.test(before) ? after.charAt(0).toUpperCase() + after.slice(1) : after);
  return SAID.reduce((said, [words, ours]) => said.replace(words, (theirs) => like(theirs, ours)), text);
}

/** Why a clip made no model; its heading says that another clip mends it. */
export function clipProblem({ title, detail, status, retryAfterS }: Problem): Problem {
  return new Problem(status === INVALID ? "This clip cannot be used" : title, saidToYou(detail), status, retryAfterS);
}
