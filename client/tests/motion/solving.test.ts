import { describe, expect, it } from "vitest";
import { LANDMARK_COUNT } from "../../src/landmarks/landmarks";
import { PoseSolving, type SeenPerson, type SolverMessage, type SolverTask, type SolverWorker } from "../../src/motion/solving";
import { CASES, bodyOf } from "./solver";

class FakeWorker implements SolverWorker {
  onmessage: SolverWorker["onmessage"] = null;
  onerror: SolverWorker["onerror"] = null;
  tasks: SolverTask[] = [];
  ended = false;
  postMessage = (task: SolverTask): void => void this.tasks.push(task);
  terminate = (): void => void (this.ended = true);
  say = (data: SolverMessage): void => this.onmessage?.({ data } as MessageEvent<SolverMessage>);
}

const BODY = bodyOf(CASES[0]!);

function person(timeMs: number): SeenPerson {
  const seen = {
    width: 640,
    height: 480,
    xy: new Float32Array(2 * LANDMARK_COUNT),
    world: new Float32Array(3 * LANDMARK_COUNT),
    visibility: new Float32Array(LANDMARK_COUNT),
  };
  return { seen, expression: null, head: null, timeMs, liveLook: false };
}

function setUp() {
  const worker = new FakeWorker();
  const solved: number[] = [];
  const failures: string[] = [];
  const hooks = { onSolved: (_: ArrayBuffer, timeMs: number) => void solved.push(timeMs), onFailed: (one: string) => void failures.push(one) };
  return { worker, solved, failures, solving: new PoseSolving(hooks, worker) };
}

describe("PoseSolving", () => {
  it("solves once the worker is ready and the body is known, in either order", () => {
    for (const bodyFirst of [true, false]) {
      const { worker, solving } = setUp();
      if (bodyFirst) solving.solveFor(BODY);
      expect(solving.offer(person(1))).toBe(false);
      worker.say({ kind: "ready" });
      if (!bodyFirst) solving.solveFor(BODY);
      expect(solving.offer(person(2))).toBe(true);
      expect(worker.tasks.map(({ kind }) => kind)).toEqual(["body", "seen"]);
    }
  });

  it("keeps the newest alone while the worker is busy", () => {
    const { worker, solved, solving } = setUp();
    worker.say({ kind: "ready" });
    solving.solveFor(BODY);
    [10, 20, 30].forEach((timeMs) => solving.offer(person(timeMs)));
    worker.say({ kind: "solved", timeMs: 10, packet: new ArrayBuffer(1) });
    worker.say({ kind: "solved", timeMs: 30, packet: null });
    solving.offer(person(40));
    const seen = worker.tasks.flatMap((task) => (task.kind === "seen" ? [task.timeMs] : []));
    expect([seen, solved]).toEqual([[10, 30, 40], [10]]);
  });

  it("says where the worker fails, and ends it", () => {
    const { worker, failures, solving } = setUp();
    worker.say({ kind: "failed", reason: "no file" });
    worker.onerror?.({ message: "no program" } as ErrorEvent);
    expect(failures).toEqual(["no file", "no program"]);
    solving.close();
    expect([worker.ended, solving.offer(person(1))]).toEqual([true, false]);
  });
});
