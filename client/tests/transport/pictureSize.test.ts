// @vitest-environment happy-dom
import { expect, test, vi } from "vitest";
import { PictureSize } from "../../src/transport/pictureSize";

function stage(width: number, height: number): HTMLElement {
  const made = document.createElement("div");
  Object.defineProperties(made, { clientWidth: { value: width }, clientHeight: { value: height } });
  return made;
}

test("pictures have the stage's shape and the size that the line carries", () => {
  const size = new PictureSize(stage(1200, 600), null, vi.fn());
  expect(size.measure()).toBe(true);
  expect(size.aspect).toBe(2);
  size.fit(512);
  expect(size.requested.width / size.requested.height).toBeCloseTo(2, 1);
  expect(Math.sqrt(size.requested.width * size.requested.height)).toBeCloseTo(512, -1);
});

test("a stage that is not shown keeps the shape it had", () => {
  const size = new PictureSize(stage(0, 600), null, vi.fn());
  expect(size.measure()).toBe(false);
  expect(size.aspect).toBe(1);
});

test("a pinned size is asked for on every stage", () => {
  const size = new PictureSize(stage(1200, 600), 640, vi.fn());
  size.measure();
  size.fit(256);
  expect(size.requested).toEqual({ width: 640, height: 640 });
  expect(size.aspect).toBe(1); // what lies above and below is cut off, and nothing beside is shown
});

test("a small stage is not worth large pictures", () => {
  const [small, large] = [stage(300, 300), stage(1900, 1000)].map((box) => new PictureSize(box, null, vi.fn()));
  small!.measure();
  large!.measure();
  expect(small!.highest).toBeLessThan(large!.highest);
});
