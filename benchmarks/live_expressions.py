"""What solving a face and hands takes beside the body, in Python and on a page.

Points are a real person's, as MediaPipe found them (benchmarks/real/ruler): finding them is not in
it. Of a face 478 become seven numbers, of each hand 21 become five.
"""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.browser import open_page
from benchmarks.real.ruler import Ruler
from benchmarks.reporting.timing import milliseconds
from capture.body.expressions import (
    ALL_GROUPS,
    USUAL_REST,
    ObservedExpression,
    face_measures,
    face_numbers,
    finger_curls,
)
from scene.arrays import Array, Float
from services.live.motion.expression_filter import ExpressionFilter

_CLIP, _FRAME = "grey_shirt_sorry", 0
_ROOT = Path(__file__).parents[1]


@dataclass(frozen=True, eq=False)
class FaceAndHands:
    """What was found in one picture."""

    face: Float[Array, "478 3"]
    hands: tuple[Float[Array, "21 3"], Float[Array, "21 3"]]

    @classmethod
    def of_a_person(cls) -> FaceAndHands:
        """Of a real frame; depths are not kept there, and are 0."""
        ruler = Ruler.read(_CLIP)
        index = next(i for i in ruler.indices if ruler.face(i) is not None and ruler.hands(i))
        face, hands = ruler.face(index), ruler.hands(index)
        assert face is not None
        return cls(_flat(face), (_flat(hands[0]), _flat(hands[-1])))


class ExpressionSolver:
    """Numbers of face and hands, smoothed as they are shown."""

    def __init__(self) -> None:
        self._filter = ExpressionFilter()

    def step(self, seen: FaceAndHands, time_s: float) -> Float[Array, "17"]:
        """The numbers at `time_s`. Raises ValueError for a face that tells nothing."""
        measures = face_measures(seen.face)
        if measures is None:
            raise ValueError("a face must be large enough and seen from the front; got another")
        curls = [finger_curls(hand) for hand in seen.hands]
        numbers = np.concatenate([face_numbers(measures, USUAL_REST), *curls])
        shown = self._filter.update(ObservedExpression(numbers, ALL_GROUPS), time_s)
        return shown.at(time_s)


def page_times() -> dict[str, float]:
    """p50 and p95 of a picture's face and hands on a page, ms, in a Chromium of this machine."""
    seen = FaceAndHands.of_a_person()
    with tempfile.TemporaryDirectory() as out, open_page() as page:
        source = Path(__file__).parent / "expression_page"
        build = ["npx", "vite", "build", str(source), "--outDir", out, "--logLevel", "warn"]
        subprocess.run([*build, "--emptyOutDir"], cwd=_ROOT / "client", check=True)
        (script,) = Path(out).glob("assets/*.js")
        page.add_script_tag(path=script, type="module")
        page.wait_for_function("() => 'measure' in window")
        asked = [seen.face.tolist(), [hand.tolist() for hand in seen.hands]]
        times_ms = page.evaluate("([face, hands]) => window.measure(face, hands)", asked)
    return milliseconds([1e-3 * one for one in times_ms])


def _flat(points: Float[Array, "N 2"]) -> Float[Array, "N 3"]:
    return np.concatenate([points, np.zeros((len(points), 1))], axis=1)
