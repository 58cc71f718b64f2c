"""Photographic textures with all their smaller copies, packed for the sampling kernel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from capture.errors import CaptureError
from capture.studio.lifelike.mhclo import require_asset
from scene.arrays import Array, Int, UInt8

LEVELS = 10
"""Copies of a texture, each half as large as the one before."""


@dataclass(frozen=True, eq=False)
class Textures:
    """Pictures, sRGB premultiplied by alpha, one after the other in memory."""

    texels: UInt8[Array, "X 4"]
    places: Int[Array, "P L 3"]
    """Of each picture's levels: first texel, height, width."""


def read_picture(path: Path) -> UInt8[Array, "H W 4"]:
    """The RGBA picture of a PNG file. Raises CaptureError where it is missing or broken."""
    require_asset(path)
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if picture is None or picture.ndim != 3:
        raise CaptureError(f"{path.name} must be a PNG in colour; got something else; fetch again")
    codes = {3: cv2.COLOR_BGR2RGBA, 4: cv2.COLOR_BGRA2RGBA}
    return np.asarray(cv2.cvtColor(picture, codes[picture.shape[2]]), np.uint8)


def pack(pictures: list[UInt8[Array, "H W 4"]]) -> Textures:
    """`pictures`, of any sizes, with their smaller copies."""
    parts, places, first = [], np.empty((len(pictures), LEVELS, 3), np.int64), 0
    for p, picture in enumerate(pictures):
        level = picture
        if level[..., 3].min() < 255:
            alpha = level[..., 3:].astype(np.uint16)
            level = np.concatenate([(level[..., :3] * alpha + 127) // 255, alpha], axis=2)
            level = level.astype(np.uint8)
        for n in range(LEVELS):
            height, width = level.shape[:2]
            places[p, n] = first, height, width
            parts.append(level.reshape(-1, 4))
            first += height * width
            half = (max(width // 2, 1), max(height // 2, 1))
            level = np.asarray(cv2.resize(level, half, interpolation=cv2.INTER_AREA))
    return Textures(np.concatenate(parts), places)
