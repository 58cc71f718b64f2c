/** What went wrong, in words for people: every failure of the page becomes one of these. */

import type { Problem as ProblemDetails } from "./types";

export class Problem extends Error {
  override readonly name = "Problem";

  constructor(
    readonly title: string,
    readonly detail: string,
    /** HTTP status; 0 where it is not about an answer. */
    readonly status = 0,
    readonly retryAfterS: number | null = null,
  ) {
    super(`${title}: ${detail}`);
  }

  /** No answer came; the same call may well succeed later. */
  get offline(): boolean {
    return this === NO_SERVER;
  }

  /** Whoever signs in may go on. */
  get needsAccount(): boolean {
    return this === SIGNED_OUT || this === NO_GUESTS;
  }

  static from(details: ProblemDetails): Problem {
    return new Problem(details.title, sentence(details.detail), details.status);
  }
}

export const NO_SERVER = new Problem(
  "The server does not answer",
  "Check that it is running and that you are connected, then try again.",
);

export const NO_GUESTS = new Problem(
  "You need an invitation",
  "This server lets in only people who were invited; open the link that you were sent.",
  403,
);
export const SIGNED_OUT = new Problem("You are no longer signed in", "Sign in again to go on.", 401);

/** The problem that an answer with an error status tells, whatever its body is. */
export function problemOf(status: number, body: string, retryAfter: string | null = null): Problem {
  if (status === 0 || status === 502 || status === 504) return NO_SERVER;
  const seconds = retryAfter === null ? Number.NaN : Number.parseFloat(retryAfter);
  const wait = Number.isFinite(seconds) ? seconds : null;
  const details = parse(body);
  if (details) return new Problem(details.title, sentence(details.detail ?? ""), status, wait);
  const [title, detail] = WORDS[status] ?? ["Something went wrong", `The server answered ${status}.`];
  return new Problem(title, detail, status, wait);
}

/** Any thrown value as a Problem. */
export function asProblem(error: unknown): Problem {
  if (error instanceof Problem) return error;
  const words = error instanceof Error ? error.message : String(error);
  return new Problem("Something went wrong on this page", sentence(words));
}

const WORDS: Record<number, readonly [string, string]> = {
  401: ["You need an invitation", "Open the link that you were sent again."],
  403: ["That is not allowed", "Your invitation does not cover this."],
  404: ["Not found", "What you asked for does not exist or has been deleted."],
  413: ["The file is too large", "Choose a shorter clip and try again."],
  429: ["Too many requests", "Wait a moment and try again."],
  503: ["The server is busy", "Wait a moment and try again."],
};

/** Title and detail of a body that is a problem; proxies on the way may answer with anything. */
function parse(body: string): { title: string; detail?: string } | null {
  try {
    const value: unknown = JSON.parse(body);
    if (typeof value !== "object" || value === null) return null;
    const { title, detail } = value as Record<string, unknown>;
    if (typeof title !== "string") return null;
    return typeof detail === "string" ? { title, detail } : { title };
  } catch {
    return null;
  }
}

/** `text` with a capital and a full stop. */
export function sentence(text: string): string {
  const trimmed = text.trim();
  if (trimmed === "") return "";
  const start = trimmed.charAt(0).toUpperCase() + trimmed.slice(1);
  return /[.!?]$/.test(start) ? start : `${start}.`;
}
