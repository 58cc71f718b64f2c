"""What a performer's face and hands do by their webcam: smoothed, and eased to rest where unseen.

A page looks at faces and hands less often than at bodies, and not always finds them. What it found
is held for a moment, then eases to rest; what comes back is taken up from where that had come to.
The filter is a One-Euro filter (Casiez et al. 2012) as that of poses (`capture.live.filter`), quick
enough for a blink.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.body.expressions import ObservedExpression
from capture.live.filter import low_pass_share
from scene.arrays import Array, Bool, Float
from scene.expression import EXPRESSION_COUNT, neutral

HELD_S = 0.3
"""So long what was seen stands, although no packet told of it; pages hold it for themselves."""
EASE_S = 0.5
"""From there to rest."""
_CUTOFF_HZ = 3.0
"""Of what does not change."""
_PER_UNIT = 2.0
"""Hz more for each unit a second: lids shut within a tenth of one."""
_SPEED_CUTOFF_HZ = 4.0
_FIRST_STEP_S = 1.0 / 30.0
"""Of what is seen again after a gap, so that it comes back smoothly too."""


@dataclass(frozen=True, eq=False)
class HeldExpression:
    """What is shown from a moment on, until more is seen."""

    values: Float[Array, "E"]
    seen_s: Float[Array, "E"]
    """When each was last seen."""

    def at(self, time_s: float) -> Float[Array, "E"]:
        """Each number at `time_s`, 0 to 1."""
        gone = np.clip((time_s - self.seen_s - HELD_S) / EASE_S, 0.0, 1.0)
        return self.values * (1.0 - gone * gone * (3.0 - 2.0 * gone))


AT_REST = HeldExpression(neutral(), np.full(EXPRESSION_COUNT, -np.inf))


class ExpressionFilter:
    """Follows one person's face and hands; belongs to one thread."""

    def __init__(self) -> None:
        self._shown = AT_REST
        self._speed = neutral()
        self._before = neutral()  # as it came: speed has no lag

    def update(self, seen: ObservedExpression | None, time_s: float) -> HeldExpression:
        """Take what was seen at `time_s`, later than anything before; what is shown from then."""
        if seen is None or not seen.known:
            return self._shown
        known, now = seen.known_numbers, np.where(seen.known_numbers, seen.values, 0.0)
        shown = self._shown.at(time_s)
        step_s = time_s - self._shown.seen_s
        fresh: Bool[Array, "E"] = known & (step_s <= HELD_S)
        # what comes back after a gap has no pace yet
        step_s = np.where(fresh, step_s, _FIRST_STEP_S)
        pace = np.where(fresh, (now - self._before) / step_s, 0.0)
        self._speed = np.where(
            fresh,
            self._speed + low_pass_share(_SPEED_CUTOFF_HZ * step_s) * (pace - self._speed),
            0.0,
        )
        cutoff_hz = _CUTOFF_HZ + _PER_UNIT * np.abs(self._speed)
        moved = shown + low_pass_share(cutoff_hz * step_s) * (now - shown)
        self._before = np.where(known, now, self._before)
        self._shown = HeldExpression(
            np.where(known, moved, self._shown.values), np.where(known, time_s, self._shown.seen_s)
        )
        return self._shown
