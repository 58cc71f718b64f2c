import { describe, expect, it } from "vitest";
import { LookSwitch } from "../../src/look/lookSwitch";

function setUp() {
  const told: boolean[] = [];
  const look: LookSwitch = new LookSwitch((on) => told.push(on));
  return { look, told };
}

describe("LookSwitch", () => {
  it("is off until it is wanted", () => {
    const { look, told } = setUp();
    expect([look.on, look.paused]).toEqual([false, false]);
    look.setWanted(true);
    look.setWanted(true);
    look.setWanted(false);
    expect(told).toEqual([true, false]);
  });

  it("pauses on a poor network, and comes back by itself", () => {
    const { look, told } = setUp();
    look.setWanted(true);
    look.setPoorNetwork(true);
    expect([look.on, look.paused]).toEqual([false, true]);
    look.setPoorNetwork(false);
    expect([look.on, look.paused]).toEqual([true, false]);
    expect(told).toEqual([true, false, true]);
  });

  it("stays off after a poor network where it was switched off meanwhile, or never on", () => {
    const { look } = setUp();
    look.setPoorNetwork(true);
    look.setPoorNetwork(false);
    expect(look.on).toBe(false);
    look.setWanted(true);
    look.setPoorNetwork(true);
    look.setWanted(false);
    look.setPoorNetwork(false);
    expect(look.on).toBe(false);
  });
});
