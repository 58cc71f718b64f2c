import { beforeEach, describe, expect, it } from "vitest";
import { Lights } from "../../src/splats/lights";
import type { Light } from "../../src/api/types";

const lightOf = (value: number): Float32Array => new Float32Array(27).fill(value);
const ROOM: Light = {
  harmonics: Array.from({ length: 9 }, () => [7, 7, 7] as const),
  key_direction: [0, 1, 0],
  key_colour: [2, 2, 2],
};

/** What the shader is given, by name. */
const given = new Map<unknown, number[]>();
const note = (name: unknown, ...values: (number | ArrayLike<number>)[]): void => {
  given.set(name, values.flatMap((value) => (typeof value === "number" ? value : Array.from(value))));
};
const gl = { uniform1iv: note, uniform2fv: note, uniform3fv: note, uniform3f: note } as unknown as WebGL2RenderingContext;

function set(lights: Lights, yawsRad: number[]): void {
  lights.set(gl, (name) => name as unknown as WebGLUniformLocation, [1, 2, 3], yawsRad);
}

describe("Lights", () => {
  let lights: Lights;
  beforeEach(() => {
    given.clear();
    lights = new Lights();
    lights.setClipLights([lightOf(1), null, lightOf(3)]);
  });

  it("are everybody's own, turned with them, where the room has none", () => {
    set(lights, [0, 1, Math.PI / 2]);
    expect(given.get("lit")?.slice(0, 4)).toEqual([1, 0, 1, 0]);
    expect(given.get("harmonics")?.slice(0, 27)).toEqual(Array(27).fill(1));
    expect(given.get("harmonics")?.slice(54, 81)).toEqual(Array(27).fill(3));
    expect(given.get("clipYaw")?.slice(4, 6)).toEqual([expect.closeTo(0, 6), 1]);
    expect(given.get("keyColour")).toEqual([0, 0, 0]);
  });

  it("are the room's on everybody, turned with nobody, until it has none again", () => {
    lights.setRoom(ROOM);
    set(lights, [1, 1, 1]);
    expect(given.get("lit")?.slice(0, 4)).toEqual([1, 1, 1, 0]);
    expect(given.get("harmonics")?.slice(0, 81)).toEqual(Array(81).fill(7));
    expect(given.get("clipYaw")?.slice(0, 6)).toEqual([1, 0, 1, 0, 1, 0]);
    expect(given.get("keyColour")).toEqual([2, 2, 2]);
    lights.setRoom(null);
    set(lights, [0, 0, 0]);
    expect(given.get("lit")?.slice(0, 4)).toEqual([1, 0, 1, 0]);
    expect(given.get("harmonics")?.slice(0, 27)).toEqual(Array(27).fill(1));
  });
});
