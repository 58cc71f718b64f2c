/** The steps of a guided recording as a list: which is on, what became of the others, and a way to do each anew. */

import type { GuideState } from "../enrolment/guide";
import { STEPS, type StepName } from "../enrolment/steps";
import { h } from "./dom";
import { icon } from "./icons";

export interface GuideStepsView {
  element: HTMLElement;
  show(state: GuideState): void;
}

export function guideSteps(onStep: (name: StepName) => void): GuideStepsView {
  const lines = STEPS.map(({ name, title }) => {
    const dot = h("span", { className: "dot", attributes: { "aria-hidden": "true" } });
    const result = h("span", { className: "guide-result" });
    const press = h("button", { type: "button", className: "guide-step", testId: `step-${name}`, onclick: () => onStep(name) }, dot, h("span", {}, title), result);
    return { name, dot, result, press, item: h("li", {}, press) };
  });
  const show = ({ current, outcomes }: GuideState): void => {
    for (const { name, dot, result, press } of lines) {
      const status = name === current ? "current" : (outcomes[name] ?? "open");
      if (press.dataset["status"] === status) continue;
      press.dataset["status"] = status;
      if (status === "current") press.setAttribute("aria-current", "step");
      else press.removeAttribute("aria-current");
      dot.replaceChildren(...(status === "passed" ? [icon("check")] : []));
      result.textContent = status === "passed" ? "Recorded" : status === "skipped" ? "Skipped" : "";
    }
  };
  return { element: h("ol", { className: "guide-steps", attributes: { "aria-label": "Steps" } }, ...lines.map(({ item }) => item)), show };
}
