"""The part of a clip's pictures that the fit looks at closely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from capture.segmentation.masks import mask_bounds
from scene.arrays import Array, Float

_SOLID, _MARGIN = 0.5, 0.05


@dataclass(frozen=True, eq=False)
class Window:
    """The part of the pictures that holds the person in all frames, and its scale."""

    x: int
    y: int
    width: int
    """Of the window, px of the full picture."""
    height: int
    scale: float
    """Pixels of the window a pixel of the picture."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in its own pixels."""
        return max(1, round(self.width * self.scale)), max(1, round(self.height * self.scale))

    def inside(self, pixels: Array) -> Array:
        """Pixels of the picture as pixels of the window."""
        return (pixels - np.array([self.x, self.y], dtype=np.float32)) * np.float32(self.scale)

    def cut(self, picture: Array) -> Array:
        """What the window shows of `picture` [H W], in its own pixels."""
        part = picture[self.y : self.y + self.height, self.x : self.x + self.width]
        if part.dtype != np.uint8:
            part = part.astype(np.float32)
        return cv2.resize(part, self.size, interpolation=cv2.INTER_AREA)


def window_around(masks: Sequence[Float[Array, "H W"] | None], side_px: int) -> Window:
    """That of a clip with these `masks` (None: the person was lost), at most `side_px` long."""
    height, width = next(mask.shape for mask in masks if mask is not None)
    x, y, wide, high = mask_bounds(masks, _SOLID, _MARGIN) or (0, 0, width, height)
    return Window(x, y, wide, high, min(1.0, side_px / max(wide, high)))
