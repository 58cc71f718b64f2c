"""Foreground colour estimation: removes the background's share from the person's edge.

A pixel of alpha a shows I = a F + (1 - a) B. F and B begin as the means of certain foreground
and background around it, then F moves so that the equation holds (one round of blur-fusion
foreground estimation, Forte 2021). Where alpha is 1 the picture is F itself.
"""

from __future__ import annotations

import cv2
import numpy as np

from scene.arrays import Array, Float, UInt8

_RADIUS = 3
"""px: half the window of the means; hair and fingers are as thin."""
_ALPHA_POWER = 4
"""Power of alpha that weighs a pixel: half-covered pixels are bad samples of either side."""


def premultiplied(
    image: UInt8[Array, "H W 3"], alpha: Float[Array, "H W"]
) -> Float[Array, "H W 3"]:
    """F times alpha, float32 sRGB in [0, 1], without the background's colour."""
    seen = image.astype(np.float32) / np.float32(255.0)
    share = alpha[..., None]
    rows, columns = np.flatnonzero((alpha > 0.0).any(axis=1)), np.flatnonzero((alpha > 0).any(0))
    if not len(rows):
        return np.zeros_like(seen)
    grown = _RADIUS + 1
    window = (
        slice(max(0, int(rows[0]) - grown), int(rows[-1]) + 1 + grown),
        slice(max(0, int(columns[0]) - grown), int(columns[-1]) + 1 + grown),
    )
    out = np.zeros_like(seen)
    out[window] = _foreground_colour(seen[window], share[window]) * share[window]
    return out


def _foreground_colour(seen: Array, share: Array) -> Float[Array, "h w 3"]:
    foreground = _weighted_colour(seen, share**_ALPHA_POWER)
    background = _weighted_colour(seen, (1.0 - share) ** _ALPHA_POWER)
    mixed = share * foreground + (1.0 - share) * background
    return np.clip(foreground + share * (seen - mixed), 0.0, 1.0)


def _weighted_colour(seen: Array, weight: Array) -> Float[Array, "h w 3"]:
    """Weighted mean colour around each pixel; black where the weights are zero."""
    return _mean(seen * weight) / (_mean(weight)[..., None] + 1e-4)


def _mean(values: Array) -> Array:
    return cv2.blur(values, (2 * _RADIUS + 1, 2 * _RADIUS + 1))
