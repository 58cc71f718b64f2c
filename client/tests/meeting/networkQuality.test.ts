import { describe, expect, it } from "vitest";
import { NetworkQualityMeter } from "../../src/meeting/networkQuality";

function told(meter: NetworkQualityMeter, ...beatsMs: number[]): (string | null)[] {
  return beatsMs.map((one) => meter.observe(one)).filter((level) => level !== null);
}

describe("NetworkQualityMeter", () => {
  it("tells a level once it is sure, and each change of it", () => {
    const meter = new NetworkQualityMeter();
    expect(told(meter, 20, 20, 20, 20)).toEqual([]);
    expect(told(meter, 20)).toEqual(["good"]);
    expect(told(meter, 900)).toEqual([]);
    expect(told(meter, 900, 900, 900)).toEqual(["poor"]);
    expect(told(meter, 20, 20, 20, 20, 20)).toEqual(["good"]);
  });

  it("does not waver at a border", () => {
    const meter = new NetworkQualityMeter();
    expect(told(meter, 160, 160, 160, 160, 160)).toEqual(["fair"]);
    expect(told(meter, 140, 140, 140, 155, 140, 140)).toEqual([]);
    expect(told(meter, 100, 100, 100, 100, 100)).toEqual(["good"]);
  });

  it("begins anew with another line", () => {
    const meter = new NetworkQualityMeter();
    expect(told(meter, 20, 20, 20, 20, 20)).toEqual(["good"]);
    meter.reset();
    expect(told(meter, 20, 20, 20, 20, 20)).toEqual(["good"]);
  });
});
