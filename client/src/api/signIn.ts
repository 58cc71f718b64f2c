/**
 * Signing in at the server's provider. The browser goes there and comes back to the page's own address with a word behind
 * the #; the token is then asked for, so that it is never in an address (services/api/login.py).
 */

import { Problem } from "./problem";
import type { TokenStore } from "./tokenStore";
import type { Access, LoggedIn } from "./types";

const NOBODY_SIGNS_IN: Access = { guests: true, login: false };
const STALE = new Problem("You are not signed in yet", "It took longer than ten minutes, or began in another browser. Try again.");
const WORDS: Record<string, Problem> = {
  denied: new Problem("You were not signed in", "The sign-in service did not let you in, or you cancelled. Try again, or ask whoever runs this server."),
  stale: STALE,
  away: new Problem("Nobody can sign in at the moment", "The sign-in service does not answer. Try again in a moment."),
  fault: new Problem("Signing in does not work", "The sign-in service answered what this server cannot trust. Tell whoever runs this server."),
};

export class SignIn {
  constructor(
    private readonly tokens: TokenStore,
    private readonly request: typeof fetch = (input, init) => fetch(input, init),
  ) {}

  /** How this server lets people in. */
  async access(): Promise<Access> {
    try {
      const response = await this.request("/v1/access");
      return response.ok ? ((await response.json()) as Access) : NOBODY_SIGNS_IN;
    } catch {
      return NOBODY_SIGNS_IN;
    }
  }

  /** Where one signs in, to come back to `page`, a path with its query. */
  static address(page: string): string {
    return `/v1/login?to=${encodeURIComponent(page)}`;
  }

  /** Back from the provider with `word`: why we are not signed in, null where we are. */
  async finish(word: string): Promise<Problem | null> {
    if (word !== "done") return WORDS[word] ?? STALE;
    const response = await this.request("/v1/login/token", { method: "POST" }).catch(() => null);
    if (!response?.ok) return STALE;
    const { token, name } = (await response.json()) as LoggedIn;
    this.tokens.signIn(token, name);
    return null;
  }
}
