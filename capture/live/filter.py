"""Smooth and briefly predict poses as they come: the One-Euro filter on rotations and places.

One-Euro (Casiez et al. 2012): a low pass whose cutoff rises with speed, so that who stands still
does not tremble and who moves is not late. Turns are filtered along geodesics: each joint moves a
share of the way, log(F^T R), from where it was to where it is seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from scene.arrays import Array, Float
from scene.motion import Pose

AT_MOST_S = 0.15
"""A longer prediction is worse than standing still."""
_Number = TypeVar("_Number", float, np.ndarray)
_SPEED_CUTOFF_HZ = 1.0
"""Of the speed itself."""


@dataclass(frozen=True)
class Smoothing:
    """How steady, and how quick to follow."""

    cutoff_hz: float = 1.5
    """Of a joint that stands still."""
    cutoff_per_rad_s: float = 1.0
    """Hz more for each rad/s."""
    cutoff_per_m_s: float = 4.0
    """Hz more for each m/s."""


class PoseFilter:
    """Filters one person's poses."""

    def __init__(self, smoothing: Smoothing) -> None:
        self._smoothing = smoothing
        self._time_s: float | None = None
        self._rotations = np.tile(np.eye(3), (24, 1, 1))
        self._root = np.zeros(3)
        self._seen = self._rotations, self._root  # the last ones as they came: speed has no lag
        self._angular_velocity = np.zeros((24, 3))
        self._velocity = np.zeros(3)

    def add(
        self, rotations: Float[Array, "24 3 3"], root: Float[Array, "3"], time_s: float
    ) -> None:
        """Take the local rotations and the root's translation (m) seen at `time_s`."""
        if self._time_s is None:
            self._rotations, self._root, self._time_s = rotations.copy(), root.copy(), time_s
            self._seen = rotations, root
            return
        from capture.live.kernels import filter_rotations

        step_s, s = time_s - self._time_s, self._smoothing
        before, root_before = self._seen
        filter_rotations(
            self._rotations, self._angular_velocity, before, rotations, step_s,
            _SPEED_CUTOFF_HZ, s.cutoff_hz, s.cutoff_per_rad_s,
        )  # fmt: skip
        moving = (root - root_before) / step_s
        self._velocity += low_pass_share(_SPEED_CUTOFF_HZ * step_s) * (moving - self._velocity)
        cutoff_hz = s.cutoff_hz + s.cutoff_per_m_s * math.sqrt(
            float(self._velocity @ self._velocity)
        )
        self._root = self._root + low_pass_share(cutoff_hz * step_s) * (root - self._root)
        self._time_s, self._seen = time_s, (rotations, root)

    def pose(self, time_s: float) -> Pose:
        """The pose at `time_s`, moved on at its pace if that is later than the last one seen."""
        if self._time_s is None:
            return Pose.rest(time_s)
        from scene.kinematics_kernels import integrate_rotations

        ahead_s = min(max(time_s - self._time_s, 0.0), AT_MOST_S)
        angles = integrate_rotations(self._rotations, self._angular_velocity, ahead_s)
        return Pose(angles, self._root + ahead_s * self._velocity, time_s)


def low_pass_share(cycles: _Number) -> _Number:
    """How far a low pass goes in a step of so many cycles of its cutoff, 0 to 1."""
    ratio = 2.0 * math.pi * cycles
    return ratio / (1.0 + ratio)
