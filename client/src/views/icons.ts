/** The page's pictures: one stroke weight, drawn in the colour of the text. */

import { svg } from "./dom";

const stroke = (paths: string): string =>
  `<svg class="icon" viewBox="0 0 24 24" fill="none" stroke="currentColor" stroke-width="1.75" ` +
  `stroke-linecap="round" stroke-linejoin="round" aria-hidden="true">${paths}</svg>`;

const ICONS = {
  arrow: '<path d="M5 12h14M13 6l6 6-6 6"/>',
  camera: '<rect x="3" y="6" width="12.5" height="12" rx="3"/><path d="m15.5 10.5 5.5-3v9l-5.5-3"/>',
  check: '<path d="m5 12.5 4.5 4.5L19 7.5"/>',
  help: '<circle cx="12" cy="12" r="9"/><path d="M9.5 9.5a2.5 2.5 0 1 1 3.6 2.2c-.8.4-1.1.9-1.1 1.8"/><path d="M12 16.8h.01"/>',
  leave: '<path d="M14 4h3a3 3 0 0 1 3 3v10a3 3 0 0 1-3 3h-3"/><path d="M4 12h11M11 8l4 4-4 4"/>',
  link: '<path d="M10 14a4 4 0 0 0 5.7 0l3-3A4 4 0 0 0 13 5.3l-1 1"/><path d="M14 10a4 4 0 0 0-5.7 0l-3 3a4 4 0 0 0 5.7 5.7l1-1"/>',
  reset: '<path d="M4 12a8 8 0 1 0 2.6-5.9"/><path d="M4 4v4.5h4.5"/>',
  upload: '<path d="M12 15.5V4.5M7.5 9 12 4.5 16.5 9"/><path d="M4 15.5V17a3 3 0 0 0 3 3h10a3 3 0 0 0 3-3v-1.5"/>',
  warning: '<path d="M12 4 3 19.5h18L12 4Z"/><path d="M12 10.5v4M12 17.2h.01"/>',
} as const;

export type IconName = keyof typeof ICONS;

export function icon(name: IconName): SVGElement {
  return svg(stroke(ICONS[name]));
}

/** The mark: a person, and the way round them. */
export function mark(): SVGElement {
  return svg(
    '<svg class="mark" viewBox="0 0 32 32" fill="none" stroke-linecap="round" aria-hidden="true">' +
      '<circle cx="16" cy="8.5" r="4" fill="currentColor"/>' +
      '<path d="M9.5 23v-1.5a6.5 6.5 0 0 1 13 0V23" stroke="currentColor" stroke-width="3"/>' +
      '<path class="mark-way" d="M7 17.6c-2.6 1-4.2 2.4-4.2 3.9 0 3.2 5.9 5.7 13.2 5.7s13.2-2.5 13.2-5.7c0-1.5-1.6-2.9-4.2-3.9" stroke-width="2.2"/>' +
      "</svg>",
  );
}

/** Somebody seen from four sides while turning once. */
export function turningFigure(): SVGElement {
  const person = (x: number, body: string, extra = ""): string =>
    `<g transform="translate(${x} 0)"><circle cx="0" cy="16" r="7.5"/>${body}${extra}</g>`;
  const front = '<path d="M-13 76V46a13 13 0 0 1 26 0v30"/><path d="M-5 108V80M5 108V80"/>';
  const side = '<path d="M-7 76V46a7 13 0 0 1 14 0v30"/><path d="M-2 108V80M3 108V80"/>';
  const eyes = '<path d="M-2.8 15v.8M2.8 15v.8"/>';
  const nose = (way: number): string => `<path d="M${way * 7.5} 16.5h${way * 3}"/>`;
  return svg(
    '<svg class="turning" viewBox="0 0 320 150" fill="none" stroke="currentColor" stroke-width="2" stroke-linecap="round" stroke-linejoin="round" role="img" aria-label="A person seen from the front, the left, the back and the right while turning once">' +
      person(40, front, eyes) +
      person(120, side, nose(1)) +
      person(200, front) +
      person(280, side, nose(-1)) +
      '<g class="turning-way"><path d="M40 134c30 10 210 10 240 0"/><path d="m271 131 9.5 2.8-6 7.8"/></g></svg>',
  );
}
