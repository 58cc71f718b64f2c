"""What the clip-wide fit found."""

from __future__ import annotations

from dataclasses import dataclass

from scene.arrays import Array, Float
from scene.body import Body


@dataclass(frozen=True, eq=False)
class Fit:
    """What the fit found, in OpenGL's camera frame: y up, z towards the viewer, the camera at 0."""

    body: Body
    focal_px: float
    joint_angles: Float[Array, "F 24 3"]
    """rad, axis-angle, relative to the parent; joint 0 to the camera frame."""
    pelvis: Float[Array, "F 3"]
    """Position of joint 0, m."""
    landmark_error_px: Float[Array, "F 33"]
    """Reprojection error of each landmark; NaN where it was not seen."""
    weights: Float[Array, "F 33"]
    """Trust in each landmark, 0 to 1."""
    floor: Float[Array, "4"] | None
    """Normal (unit, up) and distance from the camera along it, m, where feet show a floor."""
    up: Float[Array, "3"]
    """The vertical (unit), by the scene and by people who stand upright in it."""
