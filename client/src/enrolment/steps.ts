/**
 * The steps of a guided recording, and what each asks of a picture: somebody found, in light, sharp, and as far turned,
 * near or spread as the step needs. Pure: a picture comes in as landmarks and two numbers.
 */

import type { PictureQuality } from "../capture/pictureQuality";
import type { Landmarks } from "../landmarks/landmarks";
import { turnOf, type Turn } from "../landmarks/turn";

export type StepName = "face" | "turn_left" | "turn_right" | "step_back" | "arms" | "around" | "hands";

/** What the camera showed at `timeMs`. */
export interface Observation {
  timeMs: number;
  seen: Landmarks | null;
  /** Of the person; of the whole picture where nobody was found. */
  quality: PictureQuality;
}

/** Whether a picture is as the step asks; `rate`, at which it counts, is 0 where not, and `words` say why. */
export interface Verdict {
  rate: number;
  words: string;
  /** Worth recording already, on the way to what the step asks. */
  isUnderWay?: boolean;
}

export interface GuideStep {
  name: StepName;
  /** For the list. */
  title: string;
  /** What to do, read from across a room. */
  instruction: string;
  /** How long it must be done, ms; null: until all sides of the body were seen. */
  holdMs: number | null;
  check(somebody: Somebody): Verdict;
}

/** Who was found, in the terms of the steps. */
export interface Somebody {
  seen: Landmarks;
  turn: Turn;
  /** Of ears, eyes, nose and mouth together, in shares of the picture's shorter side. */
  headSize: number;
}

const VISIBLE = 0.5;
const HEAD_POINTS = Array.from({ length: 11 }, (_, i) => i);
const SHOULDERS = [11, 12];
const ELBOWS = [13, 14];
const UPPER_BODY = [0, ...SHOULDERS];
const LEGS = [25, 26, 27, 28];
const ARM = { left: [11, 13, 15, 19], right: [12, 14, 16, 20] } as const;
type Hand = keyof typeof ARM;

/** Landmarks of the head fill so much of the picture at arm's length from a webcam, at most, and a chair's push farther. */
const CLOSE = 0.25;
const TOO_CLOSE = 0.5;
const FAR = 0.2;
const NEAR = 0.12;
/** A profile is narrower than a face. */
const CLOSE_IN_PROFILE = 0.1;
const STRAIGHT_DEG = 25;
const PROFILE_DEG = 50;
const UNDER_WAY_DEG = 15;
const FACE_HIDDEN_DEG = 110;
/** Upper arms from straight down, as a picture shows them: arms that hang are 10 to 18 degrees out. */
const ARMS_OUT_DEG = [22, 75] as const;
/** Beyond the picture's edge a landmark is a guess. */
const EDGE = 0.01;
const SEATED_RATE = 0.5;

const TOO_DARK = 0.3;
const TOO_BLURRED = 0.035;
const GOOD: Verdict = { rate: 1, words: "Good. Hold still." };

export const STEPS: readonly GuideStep[] = [
  {
    name: "face",
    title: "Face, close",
    instruction: "Come close and look at the camera",
    holdMs: 3000,
    check: ({ seen, headSize, turn }) => {
      if (headSize < CLOSE) return notYet("Come closer to the camera.");
      if (headSize > TOO_CLOSE || !inPicture(seen, HEAD_POINTS)) return notYet("Your head is not all in the picture: move back a little.");
      if (Math.abs(turn.head) > STRAIGHT_DEG) return notYet("Look straight at the camera.");
      return GOOD;
    },
  },
  profile("turn_left", "Head to the left", "left"),
  profile("turn_right", "Head to the right", "right"),
  {
    name: "step_back",
    title: "Farther away",
    instruction: "Step back until you are all in view, or stay seated",
    holdMs: 2000,
    check: ({ seen, turn, headSize: size }) => {
      if (!inPicture(seen, HEAD_POINTS)) return notYet("Your head is not all in the picture.");
      if (size > FAR || !inPicture(seen, SHOULDERS)) return notYet("Move back: so close, little but your face is seen.");
      if (Math.abs(turn.body) > 2 * STRAIGHT_DEG) return notYet("Face the camera with your whole body.");
      if (allVisible(seen, LEGS)) return GOOD;
      return { rate: SEATED_RATE, words: "Your upper body is in view. Step back for the rest, or stay seated." };
    },
  },
  {
    name: "arms",
    title: "Arms out a little",
    instruction: "Hold your arms out a little, away from your body",
    holdMs: 2000,
    check: ({ seen, turn }) => {
      if (Math.abs(turn.body) > 2 * STRAIGHT_DEG) return notYet("Face the camera with your whole body.");
      if (!allVisible(seen, ELBOWS)) return notYet("Move back until both elbows are in the picture.");
      for (const side of ["left", "right"] as const) {
        const angle = armAngle(seen, side);
        if (angle < ARMS_OUT_DEG[0]) return notYet(`Move your ${side} arm farther out.`);
        if (angle > ARMS_OUT_DEG[1] || handIsUp(seen, side)) return notYet(`Lower your ${side} arm.`);
      }
      return GOOD;
    },
  },
  {
    name: "around",
    title: "Once around",
    instruction: "If there is room, turn around once, slowly",
    holdMs: null,
    check: () => ({ rate: 1, words: "Keep turning, slowly." }),
  },
  {
    name: "hands",
    title: "Both hands",
    instruction: "Hold both hands up, palms to the camera",
    holdMs: 2000,
    check: ({ seen }) => {
      for (const side of ["left", "right"] as const) if (!handIsUp(seen, side)) return notYet(`Hold up your ${side} hand, all of it in the picture.`);
      return GOOD;
    },
  },
];

export function stepOf(name: StepName): GuideStep {
  return STEPS.find((step) => step.name === name) as GuideStep;
}

/** Whether what was observed is as `step` asks. */
export function judge(step: GuideStep, { seen, quality }: Observation): Verdict {
  if (quality.brightness < TOO_DARK) return notYet("Too dark: turn on a light in front of you.");
  if (!seen || !isSomebody(seen)) return notYet("Nobody is in the picture.");
  const verdict = step.check({ seen, turn: turnOf(seen), headSize: headSize(seen) });
  if (verdict.rate > 0 && quality.sharpness < TOO_BLURRED) return notYet("Blurred: hold still, and wipe the lens.");
  return verdict;
}

/** A detector that has followed somebody may go on to guess where nobody is any more. */
function isSomebody({ visibility }: Landmarks): boolean {
  return UPPER_BODY.reduce((sum, i) => sum + (visibility[i] ?? 0), 0) / UPPER_BODY.length > VISIBLE;
}

/** Whether a face, and not hair or a body, fills much of the picture. */
export function isNearFace(seen: Landmarks): boolean {
  return headSize(seen) > NEAR && Math.abs(turnOf(seen).head) < FACE_HIDDEN_DEG;
}

/** How head and body are turned, of what is in the picture: a face close by hides no body, but shows none. */
export function turnInView(seen: Landmarks): { head: number; body: number | null } {
  const { head, body } = turnOf(seen);
  return { head, body: headSize(seen) < FAR && inPicture(seen, SHOULDERS) ? body : null };
}

function profile(name: StepName, title: string, side: Hand): GuideStep {
  const other = side === "left" ? "right" : "left";
  const sign = side === "left" ? 1 : -1;
  return {
    name,
    title,
    instruction: `Turn your head to the ${side}`,
    holdMs: 1200,
    check: ({ headSize: size, turn }) => {
      const turned = sign * turn.head;
      if (turned < -STRAIGHT_DEG) return notYet(`That is your ${other}: turn to your ${side}.`);
      if (turned < PROFILE_DEG) return { ...notYet(`Turn farther to the ${side}.`), isUnderWay: turned > UNDER_WAY_DEG };
      if (size < CLOSE_IN_PROFILE) return notYet("Come closer to the camera.");
      return GOOD;
    },
  };
}

function notYet(words: string): Verdict {
  return { rate: 0, words };
}

function headSize(seen: Landmarks): number {
  const [x, y] = [0, 1].map((axis) => HEAD_POINTS.map((i) => place(seen, i)[axis] ?? 0)) as [number[], number[]];
  const extent = Math.max(Math.max(...x) - Math.min(...x), Math.max(...y) - Math.min(...y));
  return extent / Math.min(seen.width, seen.height);
}

/** px. */
function place({ xy, width, height }: Landmarks, i: number): readonly [number, number] {
  return [(xy[2 * i] ?? 0) * width, (xy[2 * i + 1] ?? 0) * height];
}

function inPicture({ xy }: Landmarks, points: readonly number[]): boolean {
  return points.every((i) => [xy[2 * i] ?? 0, xy[2 * i + 1] ?? 0].every((share) => share > EDGE && share < 1 - EDGE));
}

function allVisible(seen: Landmarks, points: readonly number[]): boolean {
  return inPicture(seen, points) && points.every((i) => (seen.visibility[i] ?? 0) > VISIBLE);
}

/** Of an upper arm, outwards from straight down, degrees. */
function armAngle(seen: Landmarks, side: Hand): number {
  const [shoulder, elbow] = [place(seen, ARM[side][0]), place(seen, ARM[side][1])];
  const outwards = Math.sign(place(seen, SHOULDERS[0] as number)[0] - place(seen, SHOULDERS[1] as number)[0]);
  const out = (side === "left" ? outwards : -outwards) * (elbow[0] - shoulder[0]);
  return (Math.atan2(out, elbow[1] - shoulder[1]) * 180) / Math.PI;
}

function handIsUp(seen: Landmarks, side: Hand): boolean {
  const [, elbow, wrist, fingers] = ARM[side];
  const above = (a: number, b: number): boolean => place(seen, a)[1] < place(seen, b)[1];
  return allVisible(seen, [wrist, fingers]) && above(fingers, wrist) && above(wrist, elbow);
}
