"""What splats lack beside a webcam's picture, pixel by pixel."""

from __future__ import annotations

import numpy as np

from renderer.live_look.picture import WebcamPicture
from scene.arrays import Array, Float

_LEAST = 0.04
"""Added to both sRGB of a factor: in what is nearly black, noise is no detail."""
_MOST = 4.0
"""The largest factor, and the least one's inverse."""
_BARE, _COVERED = 0.5, 0.9
"""Alpha of the splats up to which a pixel tells nothing of them, and from which all."""
_SOFTENING = np.array([0.25, 0.5, 0.25])


def detail_of(picture: WebcamPicture, drawn: Float[Array, "H W 4"]) -> Float[Array, "H W 3"]:
    """`scene.live_appearance.LaidPicture.detail` of `picture`, at whose place the splats come to
    `drawn` (premultiplied)."""
    import cv2

    alpha = drawn[..., 3:]
    known = cv2.sepFilter2D(
        picture.known(), -1, _SOFTENING, _SOFTENING, borderType=cv2.BORDER_REPLICATE
    )
    sure = np.clip((alpha - _BARE) / (_COVERED - _BARE), 0.0, 1.0) * known[..., None]
    wanted = picture.rgb.astype(np.float32) / np.float32(255.0) + _LEAST
    ratio = wanted / (drawn[..., :3] / np.maximum(alpha, 1e-3) + _LEAST)
    detail = 1.0 + sure * (np.clip(ratio, 1.0 / _MOST, _MOST) - 1.0)
    return np.ascontiguousarray(detail, dtype=np.float32)
