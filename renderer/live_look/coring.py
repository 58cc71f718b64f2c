"""What a webcam's picture shows that the model does not show as well.

A picture that was coded is coarser than a model, and its pose is never exact. Where it is no
farther from what the model shows within a pixel than that explains, the model's own colour is the
better one: differences are cored, as those of noise are in video, against the range of each
pixel's neighbours, which temporal antialiasing clamps its history to (Karis, SIGGRAPH 2014).
"""

from __future__ import annotations

import numpy as np

from renderer.live_look.picture import WebcamPicture
from scene.arrays import Array, Float

_EXPLAINED, _NEW = 0.06, 0.15
"""Difference, in sRGB, from the range of the model's own colours: up to the first a pixel shows
nothing new, from the second on all of what it shows."""
_WITHIN = 1.0 / 256.0
"""Of the picture's longest side: how far from its place the model may show a pixel's colour."""
_RIM = 1.0 / 128.0
"""The same: what lies so near an outline, of the person's or of the model's, shows nothing new. At
the one coding mixes the person with the black around, at the other lies whatever the pose is off
by; from beside, splats that look sideways have what they take there all over them. What is new
counts so far around, too, lest its own outline stay behind."""
_DRAWN = 0.5
"""Alpha of the model from which its colour counts."""
_OUTLINE, _COVERED = 0.8, 0.95
"""Alpha of the model up to which it is an outline, and from which it is none."""
_DARKEST = 0.02
_EXPOSURE_RANGE = (0.7, 1.4)


def exposure_beside(
    picture: WebcamPicture, drawn: Float[Array, "H W 4"]
) -> Float[Array, "3"] | None:
    """How bright `picture` is beside `drawn`, the model at its place (premultiplied), where both
    show the person; None where they show nobody."""
    both = (picture.known() > 0.0) & (drawn[..., 3] > _DRAWN)
    if not both.any():
        return None
    of_picture = picture.rgb[both].mean(axis=0) / 255.0
    of_model = (drawn[both][:, :3] / drawn[both][:, 3:]).mean(axis=0)
    ratio = of_picture / np.maximum(of_model, _DARKEST)
    return np.clip(ratio, *_EXPOSURE_RANGE).astype(np.float32)


def cored(
    picture: WebcamPicture, drawn: Float[Array, "H W 4"], exposure: Float[Array, "3"]
) -> Float[Array, "H W 4"]:
    """The colour that each pixel is to come to, and how well it is known, 0 to 1: that of
    `picture` where it is new, else that of `drawn`, the model there, in the picture's `exposure`.
    """
    import cv2

    side = max(picture.matte.shape)
    within, rim = (_square(max(1, round(share * side))) for share in (_WITHIN, _RIM))
    alpha = drawn[..., 3]
    own = np.minimum(drawn[..., :3] / np.maximum(alpha, 1e-3)[..., None] * exposure, 1.0)
    is_drawn = (alpha > _DRAWN)[..., None]
    least = cv2.erode(np.where(is_drawn, own, np.float32(2.0)), within)
    most = cv2.dilate(np.where(is_drawn, own, np.float32(-1.0)), within)
    seen = picture.rgb * np.float32(1.0 / 255.0)
    beyond = np.maximum(least - seen, seen - most).max(axis=-1)
    covered = np.clip((alpha - _OUTLINE) / (_COVERED - _OUTLINE), 0.0, 1.0)
    inside = cv2.erode(covered.astype(np.float32), rim)
    inside *= picture.known(rim.shape[0] // 2)
    new = np.clip((beyond - _EXPLAINED) / (_NEW - _EXPLAINED), 0.0, 1.0) * inside
    new = (cv2.dilate(new, rim) * inside)[..., None]
    return np.concatenate([own + new * (seen - own), picture.known()[..., None]], axis=-1)


def _square(reach: int) -> Array:
    side = 2 * reach + 1
    return np.ones((side, side), np.uint8)
