"""Background model of a still camera, most of whose background is visible in some frame.

The mean over the frames in which the person is elsewhere, known only where these agree: nothing is
known with a hand-held camera, behind a moving curtain or after a lamp is switched. Where it is
known, pixels that differ from it are foreground and the others background; shadows, which only
darken the background's own colour, are not foreground.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from scene.arrays import Array, Bool, Float, UInt8

FRAMES = 32
"""Frames that are enough to learn from, spread over the clip."""
_MIN_VIEWS = 4
"""Observations of a pixel needed to know it."""
_LEAST_NOISE, _MOST_NOISE = 1.5, 8.0
"""Levels of 255: even noiseless cameras have compression noise; with more, the camera is not
still."""
_MAX_DEVIATION = 3.0
"""Times the median deviation from which a pixel is not known."""
_DARKEST, _LIGHTEST = 0.6, 1.2
"""Range of the background's brightness, by shadows and the camera's exposure."""
_FOREGROUND = 5.0
"""Squared deviations a channel (1 for noise alone) of each of 3 x 3 foreground pixels."""
_FOREGROUND_LEVELS = 15.0
"""Least difference of these, levels a channel: compression smears moving edges beyond noise."""
_BACKGROUND = 1.5
"""Mean squared deviations a channel of 3 x 3 background pixels."""
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
        """Foreground and background of the window `image` at (`rows`, `columns`)."""
        background, known = self.colour[rows, columns], self.known[rows, columns]
        pixels = image.astype(np.float32)
        variance = 3.0 * self.noise**2  # of three channels
        light = _dot(pixels, background) / (_dot(background, background) + 1.0)
        shadowed = background * np.clip(light, _DARKEST, _LIGHTEST)[..., None]
        threshold = max(_FOREGROUND * variance, 3.0 * _FOREGROUND_LEVELS**2)
        is_foreground = cv2.erode(_squares(pixels - shadowed), _PATCH) > threshold
        is_background = cv2.blur(_squares(pixels - background), (3, 3)) < _BACKGROUND * variance
        return known & is_foreground, known & is_background


def learn_background(
    images: Sequence[UInt8[Array, "H W 3"]], person_masks: Iterable[UInt8[Array, "H W"]]
) -> BackgroundModel | None:
    """The background of `images`, where `person_masks` (dilated; 1: possibly the person) is 0.

    None where no pixel is known. `FRAMES` images, spread over the clip, are enough.
    """
    if len(images) < _MIN_VIEWS:
        return None
    size = images[0].shape[:2]
    count = np.zeros(size, np.float32)
    total, squares = np.zeros((*size, 3), np.float32), np.zeros((*size, 3), np.float32)
    for image, mask in zip(images, person_masks, strict=True):
        free = 1 - mask
        cv2.accumulate(image, total, free)
        cv2.accumulateSquare(image, squares, free)
        count += free
    observed = count >= _MIN_VIEWS
    if not observed.any():
        return None
    count = np.maximum(count, 1.0)[..., None]
    colour = total / count
    deviation = np.sqrt(np.maximum(squares / count - colour**2, 0.0).mean(axis=2))
    noise = max(float(np.median(deviation[observed])), _LEAST_NOISE)
    if noise > _MOST_NOISE:
        return None
    return BackgroundModel(colour, observed & (deviation < _MAX_DEVIATION * noise), noise)


def _dot(a: Array, b: Array) -> Array:
    return cv2.transform(a * b, np.ones((1, 3), np.float32))


def _squares(a: Array) -> Array:
    return _dot(a, a)
