"""sRGB (IEC 61966-2-1): light is added in linear values, pictures hold encoded ones."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array


def to_linear(encoded: Array) -> Array:
    """Linear light of sRGB values in [0, 1]; any shape."""
    low = encoded / 12.92
    return np.where(encoded <= 0.04045, low, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: Array) -> Array:
    """sRGB values of linear light, what is above 1 cut to 1; any shape."""
    shown = np.clip(linear, 0.0, 1.0)
    return np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1.0 / 2.4) - 0.055)
