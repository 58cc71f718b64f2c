/** What one sets rarely: the place, captions, one's own traces. */

import type { Api } from "../api/api";
import type { Attendance } from "../meeting/attendance";
import { captions } from "./captions";
import { h } from "./dom";
import type { Panel } from "./peoplePanel";
import { placeChoice } from "./placeChoice";
import { privacyPanel } from "./privacy";

export interface MorePanel extends Panel {
  /** What is spoken, on the stage. */
  captionLine: HTMLElement;
  /** It has been opened. */
  opened(): void;
  close(): void;
}

export function morePanel(api: Api, attendance: Attendance, complain: (words: string) => void): MorePanel {
  const place = placeChoice(api, attendance, complain);
  const spoken = captions(attendance, complain);
  const privacy = privacyPanel(api, () => undefined);
  const element = h("div", { className: "panel-body" }, place.element, spoken.element, privacy.element);
  return {
    element,
    captionLine: spoken.line,
    update: () => {
      place.update();
      spoken.update();
    },
    opened: () => void privacy.load(),
    close: () => spoken.close(),
  };
}
