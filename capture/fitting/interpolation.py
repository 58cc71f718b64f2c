"""Poses of frames in which nothing was found, from those around them."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float, Int
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle, slerp


def interpolate_poses(
    found: Int[Array, "N"],
    angles: Float[Array, "N 24 3"],
    pelvis: Float[Array, "N 3"],
    times_s: Float[Array, "F"],
) -> tuple[Float[Array, "F 24 3"], Float[Array, "F 3"]]:
    """Poses of `found` frames spread to all frames: slerp between, the nearest outside."""
    rotations = axis_angle_to_matrix(angles)
    out_angles = np.zeros((len(times_s), *angles.shape[1:]))
    out_pelvis = np.stack(
        [np.interp(times_s, times_s[found], pelvis[:, axis]) for axis in range(3)], 1
    )
    for frame, time_s in enumerate(times_s):
        after = int(np.clip(np.searchsorted(found, frame), 0, len(found) - 1))
        before = max(after - 1, 0) if found[after] > frame else after
        span = times_s[found[after]] - times_s[found[before]]
        share = (time_s - times_s[found[before]]) / span if span > 0.0 else 0.0
        blend = slerp(rotations[before], rotations[after], float(np.clip(share, 0.0, 1.0)))
        out_angles[frame] = matrix_to_axis_angle(blend)
    return out_angles, out_pelvis
