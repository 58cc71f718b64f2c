import { afterEach, describe, expect, it, vi } from "vitest";
import { loadEnvironment } from "../../src/drawing/environment";
import { fakeFetch } from "../fakes";

const LIGHT = { harmonics: [], key_direction: [0, 1, 0], key_colour: [1, 1, 1] } as const;
const PARK = { name: "park", title: "Park", picture_url: "/v1/environments/park/picture", light: { ...LIGHT, harmonics: [] } };

describe("loadEnvironment", () => {
  afterEach(() => vi.unstubAllGlobals());

  it("fetches nothing for the studio", async () => {
    const { request, calls } = fakeFetch(() => new Response("x"));
    const studio = { name: "studio", title: "Studio", picture_url: null, light: null };
    expect(await loadEnvironment(studio, "seat", request)).toEqual({ panorama: null, light: null });
    expect(calls).toEqual([]);
  });

  it("shows the seat's token, and takes the picture's bytes as they are", async () => {
    const decode = vi.fn(async () => "bitmap");
    vi.stubGlobal("createImageBitmap", decode);
    const { request, calls } = fakeFetch(() => new Response("jpeg"));
    expect(await loadEnvironment(PARK, "seat", request)).toEqual({ panorama: "bitmap", light: PARK.light });
    expect(calls[0]).toMatchObject({ path: PARK.picture_url, token: "Bearer seat" });
    expect(decode).toHaveBeenCalledWith(expect.anything(), { colorSpaceConversion: "none", premultiplyAlpha: "none" });
  });

  it("tells of refusals", async () => {
    const { request } = fakeFetch(() => new Response("{}", { status: 403 }));
    await expect(loadEnvironment(PARK, "seat", request)).rejects.toMatchObject({ status: 403 });
  });
});
