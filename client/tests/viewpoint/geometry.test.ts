import { describe, expect, it } from "vitest";
import { rotationMatrix, smallestThree } from "../../src/viewpoint/geometry";

describe("smallestThree", () => {
  it("finds the one left out by unit length", () => {
    const wxyz = smallestThree([16384, 16384, 32767], 0, 32767);
    expect(wxyz).toEqual([Math.SQRT1_2, 0, 0, Math.SQRT1_2].map((value) => expect.closeTo(value, 3)));
    expect(rotationMatrix(wxyz)).toEqual([0, -1, 0, 1, 0, 0, 0, 0, 1].map((value) => expect.closeTo(value, 3)));
  });
});
