"""A webcam's picture of a person, cut out, with the camera and the pose that go with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.checks import require_shape
from scene.motion import Pose


@dataclass(frozen=True, eq=False)
class WebcamPicture:
    """One person as their webcam saw them at one moment."""

    rgb: UInt8[Array, "H W 3"]
    """sRGB; what is not the person counts for nothing."""
    matte: UInt8[Array, "H W"]
    """255 where the person is."""
    camera: Camera
    """In the world of `pose`."""
    pose: Pose
    """Of the model's skeleton, at `time_s` of the picture."""

    def __post_init__(self) -> None:
        require_shape("rgb", self.rgb, (self.camera.height, self.camera.width, 3))
        require_shape("matte", self.matte, (self.camera.height, self.camera.width))

    def resized(self, scale: float) -> WebcamPicture:
        """`scale` times as large, box-filtered."""
        import cv2

        width, height = (
            max(1, round(scale * side)) for side in (self.camera.width, self.camera.height)
        )
        size = (width, height)
        return replace(
            self,
            rgb=cv2.resize(self.rgb, size, interpolation=cv2.INTER_AREA),
            matte=cv2.resize(self.matte, size, interpolation=cv2.INTER_AREA),
            camera=self.camera.resized(width, height),
        )

    def known(self, rim_px: int = 1) -> Float[Array, "H W"]:
        """1 inside the matte, 0 within `rim_px` of its edge and beyond: there the room shines
        through, and coding mixes the person with what is round them."""
        import cv2

        side = 2 * rim_px + 1
        inside = cv2.erode(self.matte, np.ones((side, side), np.uint8))
        return (inside > _INSIDE).astype(np.float32)


_INSIDE = 230
"""Matte from which a pixel shows nothing but the person."""
