"""Numbers as black and white cells in a picture, legible after video coding at low bitrates.

A cell is 16 x 16 px: a macroblock of its own, so that neither VP8 nor H.264 smears one into the
next, and reading averages the middle of each.
"""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Bool, UInt8

CELL_PX = 16
_BLACK, _WHITE = 16, 235
_MIDDLE = slice(CELL_PX // 4, CELL_PX - CELL_PX // 4)


def draw_cells(cells: Bool[Array, "R C"]) -> UInt8[Array, "H W"]:
    """Luma of cells, True white: rows of 16 px, in video's range."""
    shades = np.where(cells, _WHITE, _BLACK).astype(np.uint8)
    return np.kron(shades, np.ones((CELL_PX, CELL_PX), np.uint8))


def read_cells(luma: UInt8[Array, "H W"], rows: int, columns: int) -> Bool[Array, "R C"]:
    """The cells in the upper left corner of a picture's luma; True is white."""
    corner = luma[: rows * CELL_PX, : columns * CELL_PX].astype(np.float64)
    cells = corner.reshape(rows, CELL_PX, columns, CELL_PX)
    return cells[:, _MIDDLE, :, _MIDDLE].mean(axis=(1, 3)) > 128.0
