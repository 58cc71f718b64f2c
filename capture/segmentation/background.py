"""What stands behind the person: a still camera shows most of it in some frame or other.

Averaged over the frames in which the person is elsewhere, and trusted only where those agree: a
camera in the hand, a curtain that moves or a lamp that is switched leave nothing that is trusted.
Where it is known, a pixel that differs from it is somebody, and one that does not is nobody; a
shadow, which only darkens the background's own colour, is not taken for somebody.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from scene.arrays import Array, Bool, Float, UInt8

FRAMES = 32
"""Frames that are enough to learn from, spread over the clip."""
_FEWEST = 4
"""Views of a pixel from which it is known."""
_LEAST_NOISE, _MOST_NOISE = 1.5, 8.0
"""Levels of 255: a camera without noise is compressed all the same; one with more is not still."""
_STEADY = 3.0
"""A pixel that varies more than so many times as much as most do is not known."""
_DARKEST, _LIGHTEST = 0.6, 1.2
"""Shares of its light that a background keeps in a shadow and that a camera's exposure may add."""
_DIFFERS = 5.0
"""Squared deviations a channel (1 for noise alone) of each of 3 x 3 pixels that show somebody."""
_DIFFERS_LEVELS = 15.0
"""Levels a channel that they differ at least: compression smears what moves further than noise."""
_SAME = 1.5
"""Mean squared deviations a channel of 3 x 3 pixels that show nobody."""
_PATCH = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False)
class BackgroundModel:
    """The picture behind the person."""

    colour: Float[Array, "H W 3"]
    """8-bit levels, mean of the frames."""
    known: Bool[Array, "H W"]
    noise: float
    """Standard deviation of a pixel over the frames, levels."""

    def classify(
        self, image: UInt8[Array, "h w 3"], rows: slice, columns: slice
    ) -> tuple[Bool[Array, "h w"], Bool[Array, "h w"]]:
        """Where the window `image` at (`rows`, `columns`) shows somebody, and where nobody."""
        behind, known = self.colour[rows, columns], self.known[rows, columns]
        seen = image.astype(np.float32)
        unit = 3.0 * self.noise**2  # of three channels
        light = _dot(seen, behind) / (_dot(behind, behind) + 1.0)
        shadowed = behind * np.clip(light, _DARKEST, _LIGHTEST)[..., None]
        least = max(_DIFFERS * unit, 3.0 * _DIFFERS_LEVELS**2)
        differs = cv2.erode(_squares(seen - shadowed), _PATCH) > least
        same = cv2.blur(_squares(seen - behind), (3, 3)) < _SAME * unit
        return known & differs, known & same


def learn_background(
    images: Sequence[UInt8[Array, "H W 3"]], covered: Iterable[UInt8[Array, "H W"]]
) -> BackgroundModel | None:
    """The background of `images`, from where `covered` (generous; 1: maybe somebody) is 0.

    None where nothing can be trusted. `FRAMES` images, spread over the clip, are enough.
    """
    if len(images) < _FEWEST:
        return None
    size = images[0].shape[:2]
    count = np.zeros(size, np.float32)
    total, squares = np.zeros((*size, 3), np.float32), np.zeros((*size, 3), np.float32)
    for image, mask in zip(images, covered, strict=True):
        free = 1 - mask
        cv2.accumulate(image, total, free)
        cv2.accumulateSquare(image, squares, free)
        count += free
    often = count >= _FEWEST
    if not often.any():
        return None
    count = np.maximum(count, 1.0)[..., None]
    colour = total / count
    deviation = np.sqrt(np.maximum(squares / count - colour**2, 0.0).mean(axis=2))
    noise = max(float(np.median(deviation[often])), _LEAST_NOISE)
    if noise > _MOST_NOISE:
        return None
    return BackgroundModel(colour, often & (deviation < _STEADY * noise), noise)


def _dot(a: Array, b: Array) -> Array:
    return cv2.transform(a * b, np.ones((1, 3), np.float32))


def _squares(a: Array) -> Array:
    return _dot(a, a)
