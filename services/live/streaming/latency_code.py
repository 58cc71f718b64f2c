"""When the newest pose was captured, as a bar code in a picture's corner: how latency is measured.

With the setting `stamp_pictures` the server writes it into each picture's planes before they are
coded, and tells it to pages that draw for themselves, which write the same (client/src/stamp.ts).
Read back from the pixels that are shown, against the clock of the machine that captured, it is the
whole way from a webcam's landmarks to the picture: channel, solver, drawing, coding, decoding.

20 cells in two rows of ten, each 16 x 16 px, black or white, from the picture's upper left corner:
16 bits of the capture time in ms, modulo 65,536, then 4 that check them; highest first. A cell is a
macroblock of its own, so that neither VP8 nor H.264 smears one into the next, and what is read is
the mean of its middle.
"""

from __future__ import annotations

import numpy as np
from av import VideoFrame

from scene.arrays import Array, Bool, UInt8
from services.live.streaming.yuv_planes import rows_of

CELL_PX, COLUMNS, ROWS = 16, 10, 2
_BITS = np.arange(15, -1, -1)
_BLACK, _WHITE, _GREY = 16, 235, 128


def cells(captured_ms: float) -> Bool[Array, "2 10"]:
    """The code of a capture time; True is white."""
    value = int(captured_ms) % 65536
    nibbles = sum((value >> shift) & 15 for shift in (0, 4, 8, 12))
    check = (nibbles + 5) & 15  # a black corner, and a white one, are no code
    bits = np.concatenate([(value >> _BITS) & 1, (check >> _BITS[12:]) & 1])
    return bits.astype(bool).reshape(ROWS, COLUMNS)


def write(frame: VideoFrame, captured_ms: float) -> None:
    """Write the code into a yuv420p frame of at least 160 x 32 px."""
    luma, blue, red = (rows_of(plane) for plane in frame.planes)
    shades = np.where(cells(captured_ms), _WHITE, _BLACK).astype(np.uint8)
    height, width = ROWS * CELL_PX, COLUMNS * CELL_PX
    luma[:height, :width] = np.kron(shades, np.ones((CELL_PX, CELL_PX), np.uint8))
    blue[: height // 2, : width // 2] = red[: height // 2, : width // 2] = _GREY


def read(luma: UInt8[Array, "H W"]) -> int | None:
    """The capture time in ms, modulo 65,536, that a picture shows; None where there is no code."""
    corner = luma[: ROWS * CELL_PX, : COLUMNS * CELL_PX].astype(np.float64)
    middles = corner.reshape(ROWS, CELL_PX, COLUMNS, CELL_PX)[:, 4:12, :, 4:12].mean(axis=(1, 3))
    bits = (middles > 128.0).astype(int).ravel()
    value = int((bits[:16] << _BITS).sum())
    return value if (cells(value).ravel() == bits.astype(bool)).all() else None
