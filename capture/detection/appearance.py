"""Appearance of a person as a colour histogram: whether two pictures may show one person.

Bhattacharyya's coefficient of colour histograms, as in mean-shift tracking (Comaniciu et al. 2003).
Clothes are independent of pose, and hardly change as somebody turns.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from capture.detection.landmarks import Landmarks
from scene.arrays import Array, Float, UInt8

SAME_PERSON = 0.94
"""Similarity from which a detection may be the person: the same one stays above 0.97 while turning,
others in similar clothes stay below 0.88, and detections that merge two people lie between."""
_UPDATE_FROM = 0.96
"""Similarity from which a detection updates the histograms: merged detections must not."""
_HISTORY = 9
_BINS = 6
"""A colour channel."""
_KERNEL_BINS = 1.5
"""Half width of the triangular kernel, since light and noise carry colours over a bin's edge."""
_FEWEST_PX, _MOST_PX = 50, 4000


class Appearance:
    """Colour histograms of one person: of the first picture and of recent ones; empty at first."""

    def __init__(self) -> None:
        self._first: Float[Array, "6 6 6"] | None = None
        self._recent: deque[Float[Array, "6 6 6"]] = deque(maxlen=_HISTORY)

    def similarity(self, image: UInt8[Array, "H W 3"], person: Landmarks) -> float:
        """0 to 1; 1 before the first update."""
        colours = _colours(image, person)
        return 1.0 if colours is None else self._similarity(colours)

    def update(self, image: UInt8[Array, "H W 3"], person: Landmarks) -> None:
        """Add a picture of the person: people turn, and walk into the shade."""
        colours = _colours(image, person)
        if colours is None or self._similarity(colours) < _UPDATE_FROM:
            return
        self._first = colours if self._first is None else self._first
        self._recent.append(colours)

    def _similarity(self, colours: Float[Array, "6 6 6"]) -> float:
        if self._first is None:
            return 1.0
        return max(float((colours * known).sum()) for known in (self._first, *self._recent))


def _colours(image: Array, person: Landmarks) -> Float[Array, "6 6 6"] | None:
    """Square roots of the shares of colours on the person's mask; None where it is empty."""
    pixels = image[person.mask > 0.5]
    if len(pixels) < _FEWEST_PX:
        return None
    chosen = pixels[:: -(-len(pixels) // _MOST_PX)] * np.float32((_BINS - 1) / 255.0)
    away = np.abs(chosen[..., None] - np.arange(_BINS, dtype=np.float32))  # [P 3 6]
    red, green, blue = np.moveaxis(np.maximum(_KERNEL_BINS - away, 0.0), 1, 0)
    pairs = (red[:, :, None] * green[:, None, :]).reshape(len(chosen), -1)
    counts = (pairs.T @ blue).reshape((_BINS,) * 3)
    return np.sqrt(counts / counts.sum())
