/** Solves poses, off the page's own thread. Landmarks come in; packets that tell a motion go out. */

import { asProblem, problemOf } from "../api/problem";
import type { SolverConstants } from "./body";
import { readConstants } from "./constants";
import { encodeMotion } from "./motionPacket";
import { MotionSolver } from "./motionSolver";
import type { SolverMessage, SolverTask } from "./solving";

const CONSTANTS = "/v1/landmarks/solver";

// a dedicated worker's own scope speaks as a port does
const page = self as unknown as MessagePort;

async function load(): Promise<SolverConstants> {
  const response = await fetch(CONSTANTS);
  if (!response.ok) throw problemOf(response.status, await response.text());
  return readConstants(await response.arrayBuffer());
}

let constants: SolverConstants | null = null;
let solver: MotionSolver | null = null;
load().then(
  (loaded) => {
    constants = loaded;
    tell({ kind: "ready" });
  },
  (error: unknown) => tell({ kind: "failed", reason: asProblem(error).detail }),
);

page.onmessage = ({ data }: MessageEvent<SolverTask>): void => {
  if (!constants) return;
  if (data.kind === "body") {
    solver = new MotionSolver(data.body, constants);
    return;
  }
  const motion = solver?.solve(data.seen, data.expression, data.head, data.timeMs) ?? null;
  const packet = motion && encodeMotion(motion, data.liveLook);
  tell({ kind: "solved", timeMs: data.timeMs, packet });
};

function tell(answer: SolverMessage): void {
  page.postMessage(answer, answer.kind === "solved" && answer.packet ? [answer.packet] : []);
}
