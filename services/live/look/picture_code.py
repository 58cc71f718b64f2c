"""The code in a sent picture: when it was captured, and which square of the webcam's picture it is.

81 cells (`services.live.cell_code`), nine rows of nine, row by row, highest bit first: 16 bits of
the capture time in ms, modulo 65,536; 12 bits of x and 12 of y, each plus 2,048; 12 bits of the
side (px of the webcam's picture); 8 check bits; the rest black. The check bits are the CRC-8 of
the 52 before, of the polynomial x^8 + x^2 + x + 1, started at 255, so that black is no code.
client/src/look/pictureCode.ts writes it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.arrays import Array, Bool, UInt8
from services.live.cell_code import CELL_PX, read_cells

CELLS = 9
SIDE_PX = CELLS * CELL_PX
_WIDTHS = (16, 12, 12, 12)
_OFFSET = 2048
_CHECK_BITS = 8
_POLYNOMIAL = 0x07


class PictureCode(NamedTuple):
    """What the code says."""

    captured_ms: int
    """Modulo 65,536."""
    x: int
    """-2,048 to 2,047 px, as is y."""
    y: int
    side: int
    """1 to 4,095 px."""


def cells_of(code: PictureCode) -> Bool[Array, "9 9"]:
    """The cells of a code; True is white. What does not fit into its bits must not be given."""
    numbers = (code.captured_ms, code.x + _OFFSET, code.y + _OFFSET, code.side)
    told = np.concatenate([_bits(n, width) for n, width in zip(numbers, _WIDTHS, strict=True)])
    cells = np.zeros(CELLS * CELLS, bool)
    cells[: len(told)] = told
    cells[len(told) : len(told) + _CHECK_BITS] = _bits(_check(told), _CHECK_BITS)
    return cells.reshape(CELLS, CELLS)


def code_in(cells: Bool[Array, "9 9"]) -> PictureCode | None:
    """What cells say; None where they are no code."""
    numbers, at = [], 0
    for width in _WIDTHS:
        bits = cells.ravel()[at : at + width]
        numbers.append(int(bits @ (1 << np.arange(width - 1, -1, -1))))
        at += width
    captured_ms, x, y, side = numbers
    code = PictureCode(captured_ms, x - _OFFSET, y - _OFFSET, side)
    return code if side and (cells_of(code) == cells).all() else None


def read(luma: UInt8[Array, "H W"]) -> PictureCode | None:
    """The code in the upper left corner of a picture's luma; None where there is none."""
    return code_in(read_cells(luma, CELLS, CELLS))


def _bits(number: int, width: int) -> Bool[Array, "N"]:
    return (number >> np.arange(width - 1, -1, -1) & 1).astype(bool)


def _check(bits: Bool[Array, "N"]) -> int:
    rest = 0xFF
    for bit in bits.tolist():
        carry = (rest >> 7) ^ bit
        rest = (rest << 1) & 0xFF ^ (_POLYNOMIAL if carry else 0)
    return rest
