/** The page's pictures: one stroke weight, drawn in the colour of the text. */

import { svg } from "./dom";

const stroke = (paths: string): string =>
  `<svg class="icon" viewBox="0 0 24 24" fill="none" stroke="currentColor" stroke-width="1.75" ` +
  `stroke-linecap="round" stroke-linejoin="round" aria-hidden="true">${paths}</svg>`;

const ICONS = {
  agree: '<path d="M4.5 11H8v9H4.5z"/><path d="m8 11 3.5-7A2.2 2.2 0 0 1 14 6.2V10h4.3a2 2 0 0 1 2 2.3l-.9 6a2 2 0 0 1-2 1.7H8"/>',
  applause: '<path d="M8 13V8.5a1.5 1.5 0 0 1 3 0V12V6.8a1.5 1.5 0 0 1 3 0V12V8a1.5 1.5 0 0 1 3 0v7a5.5 5.5 0 0 1-5.5 5.5h-.8A5.5 5.5 0 0 1 6.5 18l-2-3.4a1.4 1.4 0 0 1 2.3-1.6Z"/><path d="M4 7.5 5.5 9M7 3.5 8 5.5M19.5 4.5 18.3 6"/>',
  arrow: '<path d="M5 12h14M13 6l6 6-6 6"/>',
  better: '<circle cx="9.5" cy="7.5" r="3.5"/><path d="M3 19.5v-1.5a6.5 6.5 0 0 1 9.5-5.8"/><path d="M17.5 20v-8M14.2 15.2l3.3-3.3 3.3 3.3"/>',
  camera: '<rect x="3" y="6" width="12.5" height="12" rx="3"/><path d="m15.5 10.5 5.5-3v9l-5.5-3"/>',
  chat: '<path d="M4 6.5A2.5 2.5 0 0 1 6.5 4h11A2.5 2.5 0 0 1 20 6.5v7a2.5 2.5 0 0 1-2.5 2.5H11l-4.5 4v-4A2.5 2.5 0 0 1 4 13.5Z"/>',
  check: '<path d="m5 12.5 4.5 4.5L19 7.5"/>',
  close: '<path d="M6 6l12 12M18 6 6 18"/>',
  enlarge: '<path d="M14 4h6v6M20 4l-7 7M10 20H4v-6M4 20l7-7"/>',
  filmed: '<circle cx="12" cy="7" r="3.5"/><path d="M5.5 20v-1.5a6.5 6.5 0 0 1 6.5-6.5"/><path d="M15.2 12.9l.2.1M17.9 15.6l.1.2M18.5 19.6v.2" stroke-width="2.2"/>',
  hand: '<path d="M7 12.5V7a1.5 1.5 0 0 1 3 0v4.5V5.2a1.5 1.5 0 0 1 3 0v6.3V6.5a1.5 1.5 0 0 1 3 0V12V9.5a1.5 1.5 0 0 1 3 0V15a6 6 0 0 1-6 6h-1.2a6 6 0 0 1-4.6-2.2L4 14.6a1.5 1.5 0 0 1 2.2-2L7 13.4"/>',
  headset: '<path d="M3 10.5A2.5 2.5 0 0 1 5.5 8h13a2.5 2.5 0 0 1 2.5 2.5v5a2.5 2.5 0 0 1-2.5 2.5H16l-2.2-2.4a2.4 2.4 0 0 0-3.6 0L8 18H5.5a2.5 2.5 0 0 1-2.5-2.5Z"/><path d="M7 8V6.5h10V8"/>',
  heart: '<path d="M12 19.5S4 14.8 4 9.3A4.3 4.3 0 0 1 12 7a4.3 4.3 0 0 1 8 2.3c0 5.5-8 10.2-8 10.2Z"/>',
  help: '<circle cx="12" cy="12" r="9"/><path d="M9.5 9.5a2.5 2.5 0 1 1 3.6 2.2c-.8.4-1.1.9-1.1 1.8"/><path d="M12 16.8h.01"/>',
  laugh: '<circle cx="12" cy="12" r="9"/><path d="M7.5 13.5h9a4.5 4.5 0 0 1-9 0ZM8.3 9.8l1.4-1 1.2 1M13.1 9.8l1.2-1 1.4 1"/>',
  leave: '<path d="M14 4h3a3 3 0 0 1 3 3v10a3 3 0 0 1-3 3h-3"/><path d="M4 12h11M11 8l4 4-4 4"/>',
  link: '<path d="M10 14a4 4 0 0 0 5.7 0l3-3A4 4 0 0 0 13 5.3l-1 1"/><path d="M14 10a4 4 0 0 0-5.7 0l-3 3a4 4 0 0 0 5.7 5.7l1-1"/>',
  lock: '<rect x="5" y="10.5" width="14" height="9.5" rx="2.5"/><path d="M8 10.5V8a4 4 0 0 1 8 0v2.5M12 14.5v2"/>',
  mic: '<rect x="9" y="3.5" width="6" height="11" rx="3"/><path d="M5.5 11.5a6.5 6.5 0 0 0 13 0M12 18v3"/>',
  micOff: '<path d="M9 9v2.5a3 3 0 0 0 5 2.2M15 11V6.5a3 3 0 0 0-5.7-1.3M5.5 11.5a6.5 6.5 0 0 0 10.6 5M18.5 11.5a6.5 6.5 0 0 1-.5 2.4M12 18v3M4 4l16 16"/>',
  more: '<path d="M5.5 12h.01M12 12h.01M18.5 12h.01" stroke-width="2.8"/>',
  party: '<path d="m12 3.8 2.3 5.3 5.7.5-4.3 3.8 1.3 5.6-5-3-5 3 1.3-5.6L4 9.6l5.7-.5Z"/>',
  people: '<circle cx="9" cy="8" r="3.2"/><path d="M3.5 19v-1a5.5 5.5 0 0 1 11 0v1M15.5 5.2a3.2 3.2 0 0 1 0 5.6M17.3 13.4a5.5 5.5 0 0 1 3.2 4.6v1"/>',
  present: '<rect x="3" y="4.5" width="18" height="12" rx="2.5"/><path d="M9 20h6M12 13.5v-6M9.3 10 12 7.3l2.7 2.7"/>',
  pause: '<path d="M8.5 5v14M15.5 5v14" stroke-width="2.6"/>',
  play: '<path d="M7.5 4.8v14.4L19 12Z"/>',
  record: '<circle cx="12" cy="12" r="8.5"/><circle cx="12" cy="12" r="3.6" fill="currentColor"/>',
  reset: '<path d="M4 12a8 8 0 1 0 2.6-5.9"/><path d="M4 4v4.5h4.5"/>',
  screen: '<rect x="3" y="4.5" width="18" height="12" rx="2.5"/><path d="M9 20h6M12 16.5V20"/>',
  send: '<path d="m4 12 16-8-4.5 16-4-7.5ZM11.5 12.5 20 4"/>',
  smile: '<circle cx="12" cy="12" r="9"/><path d="M8.2 14.2a4.6 4.6 0 0 0 7.6 0M9 9.6h.01M15 9.6h.01"/>',
  sound: '<path d="M4 9.5v5h3.5l4.5 4v-13l-4.5 4Z"/><path d="M15.5 9a4.2 4.2 0 0 1 0 6M18 6.5a7.8 7.8 0 0 1 0 11"/>',
  surprise: '<circle cx="12" cy="12" r="9"/><circle cx="12" cy="15.2" r="1.9"/><path d="M9 9.6h.01M15 9.6h.01"/>',
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
    '<svg class="logo" viewBox="0 0 32 32" fill="none" stroke-linecap="round" aria-hidden="true">' +
      '<circle cx="16" cy="8.5" r="4" fill="currentColor"/>' +
      '<path d="M9.5 23v-1.5a6.5 6.5 0 0 1 13 0V23" stroke="currentColor" stroke-width="3"/>' +
      '<path class="logo-orbit" d="M7 17.6c-2.6 1-4.2 2.4-4.2 3.9 0 3.2 5.9 5.7 13.2 5.7s13.2-2.5 13.2-5.7c0-1.5-1.6-2.9-4.2-3.9" stroke-width="2.2"/>' +
      "</svg>",
  );
}

/** Somebody seen while turning once: front, side, back, other side. */
export function turningFigure(): SVGElement {
  const wide = "M-15 47a15 15 0 0 1 30 0v23a3.4 3.4 0 0 1-6.8 0V50v56a4 4 0 0 1-7.7 0V77h-1v29a4 4 0 0 1-7.7 0V50v20a3.4 3.4 0 0 1-6.8 0z";
  const slim = "M-8 47a8 15 0 0 1 16 0v25a5 5 0 0 1-3 4.5V106a4.5 4.5 0 0 1-9 0V76.5a5 5 0 0 1-4-4.5z";
  const person = (x: number, body: string, face: string): string =>
    `<g transform="translate(${x} 0)"><path d="${body}"/><circle cy="17" r="9"/>${face}</g>`;
  const eyes = '<path class="turning-face" d="M-3.2 15.5v1.5M3.2 15.5v1.5"/>';
  const nose = (way: number): string => `<path d="M${way * 7.5} 14l${way * 5} 4.5l${way * -5} 1z"/>`;
  const label = "A person turning once: front, one side, back, other side";
  return svg(
    `<svg class="turning" viewBox="0 0 320 150" fill="currentColor" role="img" aria-label="${label}">` +
      person(40, wide, eyes) +
      person(120, slim, nose(1)) +
      person(200, wide, "") +
      person(280, slim, nose(-1)) +
      '<g class="turning-arrow"><path d="M40 130c40 12 200 12 240 0"/><path d="m270.5 126.5 10 3.3-6.5 8"/></g></svg>',
  );
}
