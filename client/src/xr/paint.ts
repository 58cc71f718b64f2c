/** Paints boards with the page's colours, type and icons. */

import { icon, type IconName } from "../views/icons";
import type { MenuItem } from "./menu";

export type Painter = CanvasRenderingContext2D;

const RADIUS = 18;
const ICON_PX = 24;
const TYPE_PX = 27;
/** Where a button's words would not fit otherwise. */
const SMALL_PX = 22;

/** The page's colours, as the theme of the system has them. */
interface Theme {
  glass: string;
  ink: string;
  accent: string;
  onAccent: string;
  font: string;
}

function theme(): Theme {
  const root = getComputedStyle(document.documentElement);
  const token = (name: string): string => root.getPropertyValue(name).trim();
  return {
    glass: token("--glass-hover"),
    ink: token("--on-glass"),
    accent: token("--accent"),
    onAccent: token("--on-accent"),
    font: root.fontFamily,
  };
}

/** The whole menu; `under` is what a ray points at. */
export function paintMenu(on: Painter, items: readonly MenuItem[], under: MenuItem | null): void {
  const how = theme();
  on.clearRect(0, 0, on.canvas.width, on.canvas.height);
  on.textBaseline = "middle";
  for (const item of items) {
    on.globalAlpha = item.disabled ? 0.45 : 1;
    if (item.kind === "sheet") paintSheet(on, item, how);
    else if (item.kind === "line") paintLine(on, item, how);
    else paintButton(on, item, how, isSameItem(item, under));
  }
  on.globalAlpha = 1;
}

/** Lines of words in the middle of a strip; nothing where there are none. */
export function paintText(on: Painter, lines: readonly string[]): void {
  const { width, height } = on.canvas;
  const how = theme();
  on.clearRect(0, 0, width, height);
  if (lines.length === 0) return;
  on.font = `500 38px ${how.font}`;
  on.textBaseline = "middle";
  on.textAlign = "center";
  const shown = lines.map((words) => ellipsize(on, words, width - 80));
  const widest = Math.max(...shown.map((words) => on.measureText(words).width)) + 64;
  const high = 56 * shown.length + 24;
  fill(on, (width - widest) / 2, height - high, widest, high, how.glass);
  on.fillStyle = how.ink;
  shown.forEach((words, nth) => on.fillText(words, width / 2, height - high + 40 + 56 * nth));
  on.textAlign = "left";
}

/** `words`, cut at the end where they are wider than `width`. */
export function ellipsize(on: Pick<Painter, "measureText">, words: string, width: number): string {
  const letters = [...words];
  const shown = (count: number): string => (count < letters.length ? `${letters.slice(0, count).join("").trimEnd()}…` : words);
  let [low, high] = [0, letters.length];
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (on.measureText(shown(middle)).width <= width) low = middle;
    else high = middle - 1;
  }
  return shown(low);
}

export function isSameItem(a: MenuItem, b: MenuItem | null): boolean {
  return b !== null && a.label === b.label && a.x === b.x && a.y === b.y;
}

function fill(on: Painter, x: number, y: number, width: number, height: number, colour: string): void {
  on.beginPath();
  on.roundRect(x, y, width, height, RADIUS);
  on.fillStyle = colour;
  on.fill();
}

function paintSheet(on: Painter, { x, y, width, height, label }: MenuItem, how: Theme): void {
  fill(on, x, y, width, height, how.glass);
  on.fillStyle = how.ink;
  on.font = `650 34px ${how.font}`;
  on.fillText(label, x + 28, y + 40);
}

function paintLine(on: Painter, item: MenuItem, how: Theme): void {
  const middle = item.y + item.height / 2;
  let x = item.x;
  on.fillStyle = on.strokeStyle = how.ink;
  if (item.icon) {
    paintIcon(on, item.icon, x, middle - 18, 36);
    x += 52;
  }
  if (item.strong) {
    on.font = `650 ${TYPE_PX}px ${how.font}`;
    const name = ellipsize(on, item.strong, item.width / 3);
    on.fillText(name, x, middle);
    x += on.measureText(name).width + 14;
  }
  on.font = `400 ${TYPE_PX}px ${how.font}`;
  on.fillText(ellipsize(on, item.label, item.x + item.width - x), x, middle);
}

function paintButton(on: Painter, item: MenuItem, how: Theme, hovered: boolean): void {
  const { x, y, width, height, label, pressed } = item;
  fill(on, x, y, width, height, pressed ? how.accent : how.glass);
  if (hovered) {
    on.lineWidth = 5;
    on.strokeStyle = how.ink;
    on.beginPath();
    on.roundRect(x + 3, y + 3, width - 6, height - 6, RADIUS - 3);
    on.stroke();
  }
  on.fillStyle = on.strokeStyle = pressed ? how.onAccent : how.ink;
  on.textAlign = "center";
  on.font = `550 ${TYPE_PX}px ${how.font}`;
  if (on.measureText(label).width > width - 16) on.font = `550 ${SMALL_PX}px ${how.font}`;
  const words = ellipsize(on, label, width - 16);
  const middle = y + height / 2;
  if (item.icon) {
    const size = Math.min(60, height * 0.42);
    paintIcon(on, item.icon, x + (width - size) / 2, middle - size - 1, size);
    on.fillText(words, x + width / 2, middle + height * 0.24);
  } else {
    on.fillText(words, x + width / 2, middle);
  }
  on.textAlign = "left";
}

/** One of the page's pictures: strokes in a square of `size` px. */
function paintIcon(on: Painter, name: IconName, x: number, y: number, size: number): void {
  on.save();
  on.translate(x, y);
  on.scale(size / ICON_PX, size / ICON_PX);
  on.lineCap = on.lineJoin = "round";
  for (const part of icon(name).children) {
    on.lineWidth = Number(part.getAttribute("stroke-width") ?? 1.75);
    on.stroke(outline(part));
  }
  on.restore();
}

function outline(part: Element): Path2D {
  const number = (name: string): number => Number(part.getAttribute(name) ?? 0);
  if (part.tagName === "path") return new Path2D(part.getAttribute("d") ?? "");
  const path = new Path2D();
  if (part.tagName === "circle") path.arc(number("cx"), number("cy"), number("r"), 0, 2 * Math.PI);
  else path.roundRect(number("x"), number("y"), number("width"), number("height"), number("rx"));
  return path;
}
