// @vitest-environment happy-dom
import { expect, it, vi } from "vitest";
import { reloadForNewGateways } from "../../src/meeting/newGateways";

function refuse(effectiveDirective: string): void {
  document.dispatchEvent(Object.assign(new Event("securitypolicyviolation"), { effectiveDirective }));
}

it("a gateway that the page may not talk to has it loaded anew, not over and over", () => {
  const reload = vi.fn();
  let nowMs = 1_000_000;
  reloadForNewGateways(reload, () => nowMs);
  refuse("script-src");
  expect(reload).not.toHaveBeenCalled();
  refuse("connect-src");
  refuse("connect-src");
  nowMs += 9_000;
  refuse("connect-src");
  expect(reload).toHaveBeenCalledOnce();
  nowMs += 2_000;
  refuse("connect-src");
  expect(reload).toHaveBeenCalledTimes(2);
});
