import { vi } from "vitest";

/** What `check` gives once it no longer throws. It may take long: no test is of the machine's speed. */
export const eventually = <Value>(check: () => Value | Promise<Value>): Promise<Value> => vi.waitFor(check, 30_000);
