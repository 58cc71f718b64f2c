/** How long the page's own solver of faces and hands takes, without the networks that find their points. */

import { RestingFaceEstimator, faceMeasures, faceNumbers, fingerCurls, type Point } from "../../client/src/landmarks/expression";

/** A clock of a page is rounded: so many pictures are timed together. */
const TOGETHER = 50;
const BATCHES = 60;
/** A minute's, as many as are kept, four a second. */
const LEARNT = 240;

/** Times of a picture with a face and hands, ms, each the mean of some. */
function measure(face: readonly Point[], hands: readonly (readonly Point[])[]): number[] {
  const rest = new RestingFaceEstimator();
  let timeMs = 0;
  const solve = (): number[] => {
    timeMs += 1000 / 30;
    const measures = faceMeasures(face);
    if (!measures) throw new RangeError("a face must be large enough, and seen from the front");
    return [...faceNumbers(measures, rest.update(measures, timeMs)), ...hands.flatMap(fingerCurls)];
  };
  while (timeMs < 250 * LEARNT) solve();
  return Array.from({ length: BATCHES }, () => {
    const startMs = performance.now();
    for (let i = 0; i < TOGETHER; i++) solve();
    return (performance.now() - startMs) / TOGETHER;
  });
}

Object.assign(window, { measure });
