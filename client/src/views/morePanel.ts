/** Rarely changed settings: environment, captions, privacy. */

import type { Api } from "../api/api";
import type { MeetingSession } from "../meeting/session";
import { captions } from "./captions";
import { h } from "./dom";
import type { Panel } from "./peoplePanel";
import { environmentPicker } from "./environmentPicker";
import { privacyPanel } from "./privacy";

export interface MorePanel extends Panel {
  /** What is spoken, on the viewport. */
  captionLine: HTMLElement;
  /** It has been opened. */
  opened(): void;
  close(): void;
}

export function morePanel(api: Api, session: MeetingSession, complain: (words: string) => void): MorePanel {
  const place = environmentPicker(api, session, complain);
  const spoken = captions(session, complain);
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
