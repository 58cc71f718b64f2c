"""One step of the One-Euro filter on rotations, see `capture.live.filter`."""

from __future__ import annotations

import math

import numba
import numpy as np

from scene.arrays import Array
from scene.kinematics_kernels import (
    multiply,
    relative_axis_angles,
    write_rotation,
)


@numba.njit(cache=True)
def filter_rotations(
    rotations: Array,  # [24 3 3], written: filtered
    angular_velocity: Array,  # [24 3], written: rad/s
    previous: Array,  # [24 3 3]: the last measurement
    measured: Array,  # [24 3 3]: this measurement
    step_s: float,
    speed_cutoff_hz: float,
    cutoff_hz: float,
    cutoff_per_rad_s: float,
) -> None:
    """One step of the One-Euro filter, each joint along its geodesic. See `capture.live.filter`."""
    measured_step, correction = (
        relative_axis_angles(previous, measured),
        relative_axis_angles(rotations, measured),
    )
    share, step, product = _share(speed_cutoff_hz, step_s), np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(rotations)):
        squared_speed = 0.0
        for c in range(3):
            angular_velocity[k, c] += share * (
                measured_step[k, c] / step_s - angular_velocity[k, c]
            )
            squared_speed += angular_velocity[k, c] ** 2
        share_of_joint = _share(cutoff_hz + cutoff_per_rad_s * math.sqrt(squared_speed), step_s)
        write_rotation(
            share_of_joint * correction[k, 0],
            share_of_joint * correction[k, 1],
            share_of_joint * correction[k, 2],
            step,
        )
        multiply(rotations[k], step, product)
        rotations[k] = product


@numba.njit(inline="always")
def _share(cutoff_hz, step_s):
    """Share of the way that a low pass goes in one step."""
    return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff_hz * step_s))
