import { describe, expect, it } from "vitest";

/** The folders of src, the lowest first: each may import itself and those before it, and only main.ts all of them. */
const FLOORS = [
  "api",
  "viewpoint",
  "capture",
  "look",
  "landmarks",
  "motion",
  "transport",
  "sealing",
  "splats",
  "recolouring",
  "drawing",
  "enrolment",
  "meeting",
  "views",
  "xr",
  "replay",
];
const SOURCES = import.meta.glob<string>("../src/*/**/*.ts", { query: "?raw", import: "default", eager: true });
const TOP = import.meta.glob("../src/*");
const RELATIVE = /["'](\.{1,2}\/[^"'\n]*)["']/g;

/** The folder of src that a file lies in; `specifier` is relative to the file. */
function folderOf(file: string, specifier = ""): string {
  const path = new URL(specifier, new URL(file, "file:///client/tests/")).pathname;
  return path.split("/")[3] ?? "";
}

function imports(source: string): string[] {
  return [...source.matchAll(RELATIVE)].map(([, specifier]) => specifier ?? "");
}

/** What of `source`, a file of src, reaches up, or out of the floors. */
function upward(file: string, source: string): string[] {
  const own = FLOORS.indexOf(folderOf(file));
  return imports(source)
    .filter((specifier) => {
      const floor = FLOORS.indexOf(folderOf(file, specifier));
      return floor < 0 || floor > own;
    })
    .map((specifier) => `${file} imports ${specifier}`);
}

describe("the folders of src", () => {
  it("each have a floor, and each floor a folder", () => {
    expect([...new Set(Object.keys(SOURCES).map((file) => folderOf(file)))].sort()).toEqual([...FLOORS].sort());
  });

  it("import only what lies below them", () => {
    expect(Object.entries(SOURCES).flatMap(([file, source]) => upward(file, source))).toEqual([]);
  });

  it("leave main.ts alone at the top", () => {
    expect(Object.keys(TOP)).toEqual(["../src/main.ts"]);
  });

  it("would be caught reaching up", () => {
    expect(upward("../src/api/api.ts", 'import { h } from "../views/dom";')).toHaveLength(1);
    expect(upward("../src/api/api.ts", 'await import("../main")')).toHaveLength(1);
    expect(upward("../src/views/dom.ts", 'import { Api } from "../api/api";')).toEqual([]);
  });
});
