"""What somebody wears, as a histogram of their colours: whether two pictures may show one person.

Bhattacharyya's coefficient of colour histograms, as in mean-shift tracking (Comaniciu et al. 2003).
Clothes say nothing of pose, and hardly change as somebody turns.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from capture.detection.landmarks import Landmarks
from scene.arrays import Array, Float, UInt8

SAME_PERSON = 0.94
"""Similarity from which somebody may be the person: the same one keeps above 0.97 as they turn,
others in similar clothes stay below 0.88, and an estimator that takes two for one comes between."""
_CERTAIN = 0.96
"""Similarity from which what is seen adds to what is known: half of somebody else must not."""
_KEPT = 9
_BINS = 6
"""A colour channel."""
_REACH = 1.5
"""Bins over which a colour counts: light and noise carry it over a bin's edge."""
_FEWEST_PX, _MOST_PX = 50, 4000


class Appearance:
    """Knows the colours of one person, from the first picture and from lately; first, nobody's."""

    def __init__(self) -> None:
        self._first: Float[Array, "6 6 6"] | None = None
        self._lately: deque[Float[Array, "6 6 6"]] = deque(maxlen=_KEPT)

    def similarity(self, image: UInt8[Array, "H W 3"], person: Landmarks) -> float:
        """0 to 1; 1 where nothing is known of them."""
        seen = _colours(image, person)
        return 1.0 if seen is None else self._similarity(seen)

    def update(self, image: UInt8[Array, "H W 3"], person: Landmarks) -> None:
        """The person looks like this now: people turn, and walk into the shade."""
        seen = _colours(image, person)
        if seen is None or self._similarity(seen) < _CERTAIN:
            return
        self._first = seen if self._first is None else self._first
        self._lately.append(seen)

    def _similarity(self, seen: Float[Array, "6 6 6"]) -> float:
        if self._first is None:
            return 1.0
        return max(float((seen * known).sum()) for known in (self._first, *self._lately))


def _colours(image: Array, person: Landmarks) -> Float[Array, "6 6 6"] | None:
    """Square roots of the shares of colours on the person's mask; None where it is empty."""
    pixels = image[person.mask > 0.5]
    if len(pixels) < _FEWEST_PX:
        return None
    chosen = pixels[:: -(-len(pixels) // _MOST_PX)] * np.float32((_BINS - 1) / 255.0)
    away = np.abs(chosen[..., None] - np.arange(_BINS, dtype=np.float32))  # [P 3 6]
    red, green, blue = np.moveaxis(np.maximum(_REACH - away, 0.0), 1, 0)
    pairs = (red[:, :, None] * green[:, None, :]).reshape(len(chosen), -1)
    counts = (pairs.T @ blue).reshape((_BINS,) * 3)
    return np.sqrt(counts / counts.sum())
