/** What every screen shares: the head of the page, buttons, a notice of what went wrong. */

import type { Problem } from "../api/problem";
import { announce, h, type Child } from "./dom";
import { icon, mark, type IconName } from "./icons";

/** A screen; `close` ends whatever it started. */
export interface View {
  element: HTMLElement;
  close(): void;
}

/** `account` says who is signed in. */
export function header(onHome: () => void, account: HTMLElement): HTMLElement {
  const home = h("button", { className: "wordmark", type: "button", onclick: onHome }, mark(), "MetaNeRF");
  home.setAttribute("aria-label", "MetaNeRF, to the start");
  return h("header", { className: "page-header" }, home, account);
}

/** Over a picture of people: what it shows, and that a machine made it, as whoever sees it must know (EU AI Act, article 50). */
export function viewportTitle(name: string): HTMLElement {
  return h("p", { className: "viewport-title glass" }, mark(), h("span", {}, name), h("small", {}, "Computer-generated"));
}

interface ButtonOptions {
  look?: "primary" | "quiet" | "glass" | "danger";
  large?: boolean;
  icon?: IconName;
  testId?: string;
  submit?: boolean;
}

export function button(label: string, onClick: () => void, options: ButtonOptions = {}): HTMLButtonElement {
  const { look = "quiet", large = false } = options;
  const element = h("button", {
    type: options.submit ? "submit" : "button",
    className: `button ${look}${large ? " large" : ""}`,
    onclick: onClick,
    ...(options.testId ? { testId: options.testId } : {}),
  });
  if (options.icon) element.append(icon(options.icon));
  element.append(h("span", {}, label));
  return element;
}

/** What went wrong, and ways on. */
export function notice(problem: Problem, ...ways: Child[]): HTMLElement {
  announce(`${problem.title}. ${problem.detail}`);
  return h(
    "div",
    { className: "notice", testId: "error", attributes: { role: "alert" } },
    icon("warning"),
    h(
      "div",
      {},
      h("h2", {}, problem.title),
      problem.detail !== "" && h("p", {}, problem.detail),
      ways.length > 0 && h("div", { className: "actions" }, ...ways),
    ),
  );
}
