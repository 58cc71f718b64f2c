/** The panel beside the picture: one of several at a time, each with a button in the dock. */

import { h } from "./dom";
import type { Panel } from "./peoplePanel";
import { button } from "./shell";

export type PanelName = "people" | "chat" | "more";

export interface PanelPage extends Panel {
  title: string;
  toggle: HTMLButtonElement;
  /** Where typing begins; else the title is focused. */
  focus?(): void;
  opened?(): void;
}

export interface SidePanel {
  element: HTMLElement;
  readonly open: PanelName | null;
}

/** `onChange` hears of each opening and closing. */
export function sidePanel(pages: Record<PanelName, PanelPage>, onChange: () => void): SidePanel {
  const title = h("h2", { tabIndex: -1, id: "panel-title" });
  const shut = button("Close", () => open(null), { icon: "close", testId: "panel-close" });
  shut.classList.add("icon-only");
  const all = Object.entries(pages) as [PanelName, PanelPage][];
  const element = h(
    "section",
    { className: "panel", hidden: true, testId: "panel", attributes: { "aria-labelledby": title.id } },
    h("header", { className: "panel-header" }, title, shut),
    ...all.map(([, page]) => page.element),
  );
  const made = { element, open: null as PanelName | null };
  const open = (next: PanelName | null): void => {
    const last = made.open;
    made.open = next;
    element.hidden = next === null;
    for (const [name, page] of all) {
      page.element.hidden = name !== next;
      page.toggle.setAttribute("aria-expanded", String(name === next));
    }
    onChange();
    if (next === null) {
      if (last) pages[last].toggle.focus();
      return;
    }
    const page = pages[next];
    title.textContent = page.title;
    page.opened?.();
    if (page.focus) page.focus();
    else title.focus();
  };
  for (const [name, page] of all) {
    page.toggle.setAttribute("aria-expanded", "false");
    page.toggle.addEventListener("click", () => open(made.open === name ? null : name));
  }
  element.addEventListener("keydown", (event) => {
    if (event.key === "Escape") open(null);
  });
  return made;
}
