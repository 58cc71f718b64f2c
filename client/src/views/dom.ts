/** Small helpers to build the page with. */

export type Child = Node | string | null | false;

type Properties<Tag extends keyof HTMLElementTagNameMap> = Partial<
  Omit<HTMLElementTagNameMap[Tag], "style" | "dataset" | "attributes">
> & {
  /** For the tests: stable names that no restyling changes. */
  testId?: string;
  /** Attributes that are no properties: aria-*, role, for. */
  attributes?: Record<string, string>;
};

/** An element with properties and children; empty children are left out. */
export function h<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag,
  properties: Properties<Tag> = {},
  ...children: Child[]
): HTMLElementTagNameMap[Tag] {
  const { testId, attributes, ...rest } = properties;
  const element = document.createElement(tag);
  Object.assign(element, rest);
  if (testId) element.dataset["testid"] = testId;
  for (const [name, value] of Object.entries(attributes ?? {})) element.setAttribute(name, value);
  element.append(...withoutEmpty(children));
  return element;
}

export function withoutEmpty(children: Child[]): (Node | string)[] {
  return children.filter((child): child is Node | string => child !== null && child !== false);
}

/** A picture from markup of our own; never from anything that came over the network. */
export function svg(markup: string): SVGElement {
  const holder = document.createElement("template");
  holder.innerHTML = markup;
  return holder.content.firstElementChild as SVGElement;
}

const ANNOUNCEMENTS_KEPT = 6;

/** Tell people who listen instead of look: a log, so that news a moment later cuts nothing off. */
export function announce(words: string): void {
  const announcer = document.getElementById("announcer");
  if (!announcer || !words || announcer.lastElementChild?.textContent === words) return;
  announcer.append(h("p", {}, words));
  while (announcer.childElementCount > ANNOUNCEMENTS_KEPT) announcer.firstElementChild?.remove();
}

/** Moves that begin here are none of the viewpoint. */
export function keepFromViewport(element: HTMLElement): void {
  for (const kind of ["pointerdown", "wheel", "dblclick", "contextmenu", "keydown"]) {
    element.addEventListener(kind, (event) => event.stopPropagation());
  }
}

export function prefersReducedMotion(): boolean {
  return matchMedia("(prefers-reduced-motion: reduce)").matches;
}

export function usesTouch(): boolean {
  return matchMedia("(pointer: coarse)").matches;
}

/** Whether the window is as narrow as a phone's; the style sheets' own limit. */
export function isNarrow(): boolean {
  return matchMedia("(max-width: 860px)").matches;
}
