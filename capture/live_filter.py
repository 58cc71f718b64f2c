"""Smooth and briefly predict poses as they come: the One-Euro filter on rotations and places.

One-Euro (Casiez et al. 2012): a low pass whose cutoff rises with speed, so that who stands still
does not tremble and who moves is not late. Turns are filtered along geodesics: each joint moves a
share of the way, log(F^T R), from where it was to where it is seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Float
from scene.motion import Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle

AT_MOST_S = 0.15
"""A longer prediction is worse than standing still."""
_SPEED_CUTOFF_HZ = 1.0
"""Of the speed itself."""


@dataclass(frozen=True)
class Smoothing:
    """How steady, and how quick to follow."""

    cutoff_hz: float = 1.5
    """Of a joint that stands still."""
    per_turn: float = 1.0
    """Hz more for each rad/s."""
    per_metre: float = 4.0
    """Hz more for each m/s."""


class PoseFilter:
    """Filters one person's poses."""

    def __init__(self, smoothing: Smoothing) -> None:
        self._smoothing = smoothing
        self._time_s: float | None = None
        self._turns = np.tile(np.eye(3), (24, 1, 1))
        self._root = np.zeros(3)
        self._seen = self._turns, self._root  # the last ones as they came: speed has no lag
        self._turning = np.zeros((24, 3))
        self._moving = np.zeros(3)

    def add(self, turns: Float[Array, "24 3 3"], root: Float[Array, "3"], time_s: float) -> None:
        """Take the local turns and the root's translation (m) seen at `time_s`."""
        if self._time_s is None:
            self._turns, self._root, self._time_s = turns.copy(), root.copy(), time_s
            self._seen = turns, root
            return
        step_s = time_s - self._time_s
        turning = _between(self._seen[0], turns) / step_s
        moving = (root - self._seen[1]) / step_s
        self._turning += _share(_SPEED_CUTOFF_HZ, step_s) * (turning - self._turning)
        self._moving += _share(_SPEED_CUTOFF_HZ, step_s) * (moving - self._moving)
        self._follow(turns, root, step_s)
        self._time_s, self._seen = time_s, (turns, root)

    def _follow(self, turns: Array, root: Array, step_s: float) -> None:
        s = self._smoothing
        pace = np.linalg.norm(self._turning, axis=1)[:, None]
        share = _share(s.cutoff_hz + s.per_turn * pace, step_s)
        self._turns = self._turns @ axis_angle_to_matrix(share * _between(self._turns, turns))
        speed = float(np.linalg.norm(self._moving))
        share = _share(s.cutoff_hz + s.per_metre * speed, step_s)
        self._root = self._root + share * (root - self._root)

    def pose(self, time_s: float) -> Pose:
        """The pose at `time_s`, moved on at its pace if that is later than the last one seen."""
        if self._time_s is None:
            return Pose.rest(time_s)
        ahead_s = float(np.clip(time_s - self._time_s, 0.0, AT_MOST_S))
        turns = self._turns @ axis_angle_to_matrix(ahead_s * self._turning)
        return Pose(matrix_to_axis_angle(turns), self._root + ahead_s * self._moving, time_s)


def _between(start: Array, end: Array) -> Array:
    """The turn from `start` to `end`, axis-angle, rad."""
    return matrix_to_axis_angle(np.swapaxes(start, -1, -2) @ end)


def _share(cutoff_hz: Array | float, step_s: float) -> Array | float:
    """How far a low pass goes in one step."""
    return 1.0 / (1.0 + 1.0 / (2.0 * np.pi * cutoff_hz * step_s))
