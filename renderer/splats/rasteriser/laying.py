"""A webcam's picture laid on its person: detail that is finer than splats.

A factor for each pixel of the picture says what the splats lack there; seen from about the webcam's
own place, a view is multiplied by it. Where a pixel of the view is in that picture follows from the
splats it shows: each knows where its centre is there, and a pixel beside the centre is as far
beside it in the picture, in the scale of both. From beside the webcam the picture fades: what its
pose is off by would put details where they are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Float
from scene.camera import Camera
from scene.live_appearance import LaidPicture

_FULL_RAD, _GONE_RAD = np.radians(8.0), np.radians(16.0)
"""Angle beside the webcam up to which a picture is laid on in full, and from which it isn't."""


@dataclass(frozen=True)
class Laying:
    """How a picture is laid on in one view."""

    strength: float
    """0 to 1."""
    scale: float
    """px of the picture for one of the view."""

    @classmethod
    def seen_by(
        cls,
        laid: LaidPicture,
        camera: Camera,
        chest_transform: Float[Array, "4 4"],
        rest_chest: Float[Array, "3"],
    ) -> Laying:
        """Of `laid` in the view of `camera`; the chest's skinning transform is from rest to the
        camera's world."""
        rotation, translation = chest_transform[:3, :3], chest_transform[:3, 3]
        chest, webcam = (rotation @ at + translation for at in (rest_chest, laid.webcam))
        to_webcam, to_view = webcam - chest, camera.position - chest
        from_webcam_m, from_view_m = (float(np.linalg.norm(to)) for to in (to_webcam, to_view))
        cosine = to_webcam @ to_view / max(from_webcam_m * from_view_m, 1e-9)
        angle_rad = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        beside = min(max((angle_rad - _FULL_RAD) / (_GONE_RAD - _FULL_RAD), 0.0), 1.0)
        focal_px = float(camera.intrinsics[0, 0])
        scale = laid.focal_px * from_view_m / max(focal_px * from_webcam_m, 1e-9)
        return cls(1.0 - beside * beside * (3.0 - 2.0 * beside), scale)


def values_to_blend(
    laid: LaidPicture, means: Float[Array, "N 2"], scale: float
) -> Float[Array, "N 3"]:
    """What splats with these `means` in the view (px) blend in place of colours, for `lay`."""
    values = laid.places.copy()
    values[:, :2] -= np.float32(scale) * means * laid.places[:, 2:]
    return values
