/** On the picture of a sealed meeting: the code to compare, what is sealed and what is not, or why nobody moves. */

import { canSeal, type Sealing } from "../sealing/sealing";
import { announce, h, keepFromViewport } from "./dom";
import { icon } from "./icons";

const COMPARE = "Compare this code with the others, aloud. If it is the same, you have the same key.";
const SEALED = "Sealed from page to page: how everybody moves, with faces and hands.";
const CLEAR = "Not sealed, so the server can read it: voices, shared screens, chat, captions, names and who is here.";
const MISSING = "Not available: rendering by the server, live look and learning from it, recordings.";
const NO_KEY = "This link lacks the meeting’s key. Nobody is seen moving here, and your movements cannot be sent. Ask for the whole link, with everything after the #.";
const INSECURE = "This address is not encrypted (https), so this browser cannot open the meeting’s motion. Nobody is seen moving here.";

/** Why nobody can be seen moving; null where there is a key. */
export function keyProblem({ key }: Sealing): string | null {
  if (key) return null;
  return canSeal() ? NO_KEY : INSECURE;
}

/** Null where the meeting is not sealed. */
export function sealedNote(sealing: Sealing | null): { element: HTMLElement; setObstacle(words: string | null): void } | null {
  if (!sealing) return null;
  const code = h("output", { className: "sealed-code", testId: "sealed-code" });
  const problem = h("p", { className: "sealed-problem", testId: "sealed-problem", hidden: true, attributes: { role: "status" } });
  const title = h("span", {});
  const compared = h("div", { hidden: !sealing.key }, code, h("p", {}, COMPARE));
  const element = h(
    "details",
    { className: "sealed glass", testId: "sealed" },
    h("summary", {}, icon("lock"), title),
    problem,
    compared,
    ...[SEALED, CLEAR, MISSING].map((words) => h("p", {}, words)),
  );
  keepFromViewport(element);
  let [obstacle, unreadable]: [string | null, string | null] = [null, null];
  const show = (): void => {
    const words = keyProblem(sealing) ?? unreadable ?? obstacle;
    const before = problem.textContent;
    title.textContent = words === null ? "Sealed" : sealing.key ? "Sealed: not everybody is seen" : "Sealed: key missing";
    problem.textContent = words ?? "";
    problem.hidden = words === null;
    if (words === null || words === before) return;
    element.open = true;
    announce(words);
  };
  sealing.motions.onUnreadable = (names) => {
    unreadable = names.length === 0 ? null : `The motion of ${names.join(", ")} does not open with your key, or is not of now, and is not shown. Compare the codes, and ask for the link anew.`;
    show();
  };
  show();
  void sealing.code().then((digits) => (code.textContent = digits));
  return {
    element,
    setObstacle: (words) => {
      obstacle = words === null ? null : `${words}. In a sealed meeting no server can draw in its place.`;
      show();
    },
  };
}
