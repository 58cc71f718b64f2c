/** How a headset's pictures become cheaper, step by step. */

import type { BudgetRules, Step } from "../splats/budget";

/** Also the eyes' sides (of the whole), and how coarse their rims are. */
export interface HeadsetStep extends Step {
  viewportScale: number;
  foveation: number;
}

export const HEADSET_STEPS: readonly HeadsetStep[] = [
  { splats: 60_000, viewportScale: 1, foveation: 0 },
  { splats: 42_000, viewportScale: 1, foveation: 0.2 },
  { splats: 30_000, viewportScale: 1, foveation: 0.4 },
  { splats: 21_000, viewportScale: 0.9, foveation: 0.6 },
  { splats: 15_000, viewportScale: 0.8, foveation: 0.8 },
  { splats: 10_000, viewportScale: 0.7, foveation: 1 },
  { splats: 7_000, viewportScale: 0.6, foveation: 1 },
  { splats: 5_000, viewportScale: 0.5, foveation: 1 },
];

/** By the time between pictures: headsets leave out whole ones. Half a second at 72 a second is judged together. */
export function headsetRules(paceMs: number): BudgetRules<HeadsetStep> {
  return { steps: HEADSET_STEPS, first: 2, paceMs, late: 1.4, window: 36 };
}
