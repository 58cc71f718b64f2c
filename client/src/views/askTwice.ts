/** A button that asks once more, and says what would happen, before it does what does not come back. */

import { h } from "./dom";
import { button } from "./shell";

interface Question {
  /** What the button says at first; its test id is `testId`. */
  ask: string;
  /** What is asked, for those who listen. */
  question: string;
  /** What happens then, in a sentence. */
  words?: string;
  /** What doing it is called; its test id is `testId`-sure. */
  yes: string;
  /** What leaving it is called. */
  no: string;
  testId: string;
  /** Where the focus goes once it is asked. */
  focus?: "yes" | "no";
}

export function askTwice({ ask, question, words, yes, no, testId, focus = "no" }: Question, onYes: () => void | Promise<void>): HTMLElement {
  const first = button(ask, () => sure(true), { testId });
  const go = async (): Promise<void> => {
    doing.disabled = true;
    await onYes();
    doing.disabled = false;
    if (element.isConnected && !answers.hidden) sure(false);
  };
  const doing = button(yes, () => void go(), { look: "danger", testId: `${testId}-sure` });
  const leaving = button(no, () => sure(false));
  const answers = h("div", { className: "actions", hidden: true, attributes: { role: "group", "aria-label": question } }, doing, leaving);
  const told = h("p", { className: "small", hidden: true }, words ?? "");
  const sure = (asking: boolean): void => {
    answers.hidden = !asking;
    told.hidden = !asking || words === undefined;
    first.hidden = asking;
    (asking ? (focus === "yes" ? doing : leaving) : first).focus();
  };
  const element = h("div", { className: "ask-twice" }, first, told, answers);
  return element;
}
