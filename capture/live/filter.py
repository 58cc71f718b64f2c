"""Smooths and briefly predicts live poses: the One-Euro filter on rotations and positions.

One-Euro (Casiez et al. 2012): a low pass whose cutoff rises with speed, so that a
person at rest does not jitter and a fast motion does not lag. Rotations are filtered along
geodesics: each joint moves a share of log(F^T R), from its filtered to its measured rotation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from scene.arrays import Array, Float
from scene.motion import Pose

AT_MOST_S = 0.15
"""Longer predictions are worse than holding the pose."""
_Number = TypeVar("_Number", float, np.ndarray)
_SPEED_CUTOFF_HZ = 1.0
"""Cutoff of the low pass on the speed itself."""


@dataclass(frozen=True)
class Smoothing:
    """Parameters of the One-Euro filter: jitter against lag."""

    cutoff_hz: float = 1.5
    """Cutoff for a joint at rest."""
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
        self._measured = (
            self._rotations,
            self._root,
        )  # the last measurements: the speed is of these, without lag
        self._angular_velocity = np.zeros((24, 3))
        self._velocity = np.zeros(3)

    def add(
        self, rotations: Float[Array, "24 3 3"], root: Float[Array, "3"], time_s: float
    ) -> None:
        """Add the local rotations and the root's translation (m) measured at `time_s`."""
        if self._time_s is None:
            self._rotations, self._root, self._time_s = rotations.copy(), root.copy(), time_s
            self._measured = rotations, root
            return
        from capture.live.filter_kernels import filter_rotations

        step_s, s = time_s - self._time_s, self._smoothing
        previous, previous_root = self._measured
        filter_rotations(
            self._rotations,
            self._angular_velocity,
            previous,
            rotations,
            step_s,
            _SPEED_CUTOFF_HZ,
            s.cutoff_hz,
            s.cutoff_per_rad_s,
        )
        measured_velocity = (root - previous_root) / step_s
        self._velocity += low_pass_share(_SPEED_CUTOFF_HZ * step_s) * (
            measured_velocity - self._velocity
        )
        cutoff_hz = s.cutoff_hz + s.cutoff_per_m_s * math.sqrt(
            float(self._velocity @ self._velocity)
        )
        self._root = self._root + low_pass_share(cutoff_hz * step_s) * (root - self._root)
        self._time_s, self._measured = time_s, (rotations, root)

    def pose(self, time_s: float) -> Pose:
        """The pose at `time_s`, extrapolated at constant velocity after the last measurement."""
        if self._time_s is None:
            return Pose.rest(time_s)
        from scene.kinematics_kernels import integrate_rotations

        ahead_s = min(max(time_s - self._time_s, 0.0), AT_MOST_S)
        angles = integrate_rotations(self._rotations, self._angular_velocity, ahead_s)
        return Pose(angles, self._root + ahead_s * self._velocity, time_s)


def low_pass_share(cycles: _Number) -> _Number:
    """Share of the way, 0 to 1, that a low pass goes in a step of `cycles` periods of its
    cutoff."""
    ratio = 2.0 * math.pi * cycles
    return ratio / (1.0 + ratio)
