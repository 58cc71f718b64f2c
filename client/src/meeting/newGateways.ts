/**
 * A page may talk to the gateways that there were when it was loaded: its security policy names them. To meet at one that came
 * later it has to be loaded anew, which keeps the seat.
 */

/** At most so often: the server may hear of the gateway a moment later than we. */
const PAUSE_MS = 10_000;
const KEY = "metanerf.reloaded";

/** Call `reload` when this page's policy keeps it from an address. */
export function reloadForNewGateways(reload: () => void, now: () => number = Date.now): void {
  document.addEventListener("securitypolicyviolation", ({ effectiveDirective }) => {
    if (effectiveDirective !== "connect-src") return;
    if (now() - Number(sessionStorage.getItem(KEY) ?? 0) < PAUSE_MS) return;
    sessionStorage.setItem(KEY, String(now()));
    reload();
  });
}
