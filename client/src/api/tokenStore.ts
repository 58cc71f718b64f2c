/** Who we are to the server, kept between calls and, in the page, between reloads. */

export interface TokenStore {
  get(): string | null;
  /** A guest's token; null where the last one is no good any more. */
  set(token: string | null): void;
  /** The name that we have signed in by, even if the token has ended since; null for whoever has not. */
  account(): string | null;
  signIn(token: string, name: string): void;
  /** Nothing of whoever was here stays. */
  signOut(): void;
  /** What makes us the host of a meeting that we opened. */
  getHost(meetingId: string): string | null;
  setHost(meetingId: string, token: string): void;
}

/** What this browser keeps has names that begin so. */
const OURS = "metanerf.";
export const TOKEN_KEY = `${OURS}token`;
const ACCOUNT_KEY = `${OURS}account`;
const HOST_KEY = `${OURS}host.`;

export const browserTokens: TokenStore = {
  // an invitation's token is for this tab; who we are otherwise, for this browser
  get: () => sessionStorage.getItem(TOKEN_KEY) ?? localStorage.getItem(TOKEN_KEY),
  set: (token) => {
    sessionStorage.removeItem(TOKEN_KEY);
    if (token === null) localStorage.removeItem(TOKEN_KEY);
    else {
      localStorage.setItem(TOKEN_KEY, token);
      localStorage.removeItem(ACCOUNT_KEY);
    }
  },
  account: () => (sessionStorage.getItem(TOKEN_KEY) === null ? localStorage.getItem(ACCOUNT_KEY) : null),
  signIn: (token, name) => {
    browserTokens.set(token);
    localStorage.setItem(ACCOUNT_KEY, name);
  },
  signOut: () => {
    for (const store of [sessionStorage, localStorage]) {
      for (const key of Object.keys(store)) if (key.startsWith(OURS)) store.removeItem(key);
    }
  },
  getHost: (meetingId) => sessionStorage.getItem(HOST_KEY + meetingId),
  setHost: (meetingId, token) => sessionStorage.setItem(HOST_KEY + meetingId, token),
};
