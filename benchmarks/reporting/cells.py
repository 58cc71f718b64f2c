"""Pictures of one size, to be put side by side."""

from __future__ import annotations

import cv2
import numpy as np

from scene.arrays import Array, Float


def in_a_cell(picture: Float[Array, "H W 3"], cell_px: tuple[int, int]) -> Float[Array, "h w 3"]:
    """`picture` in the middle of a black cell (height, width), as large as fits."""
    cell = np.zeros((*cell_px, 3))
    scale = min(whole / side for whole, side in zip(cell_px, picture.shape[:2], strict=True))
    high, wide = (max(1, round(side * scale)) for side in picture.shape[:2])
    fitted = cv2.resize(picture.astype(np.float32), (wide, high), interpolation=cv2.INTER_AREA)
    top, left = (cell_px[0] - high) // 2, (cell_px[1] - wide) // 2
    cell[top : top + high, left : left + wide] = fitted
    return cell
