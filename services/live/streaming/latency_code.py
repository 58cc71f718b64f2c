"""Measures latency: pictures show, as a bar code, when the newest keypoints in them were captured.

With the setting `stamp_pictures` this is passed to the view sessions. Each picture then carries the
code in its upper left corner before it is encoded, and pose packets carry the same time, from which
pages that draw the room themselves write the same code (client/src/transport/latencyCode.ts). Read
back from the pixels that are shown, against the clock of the machine that captured, it gives the
latency from a webcam's landmarks to the picture: channel, solver, drawing, encoding, decoding.

The code is 20 cells (`services.live.cell_code`) in two rows of ten: 16 bits of the capture time in
ms, modulo 65,536, then 4 check bits; highest first.
"""

from __future__ import annotations

import numpy as np
from av import VideoFrame

from scene.arrays import Array, Bool, UInt8
from services.live.cell_code import CELL_PX, draw_cells, read_cells
from services.live.room import Room
from services.live.streaming.instrumentation import Instrumentation
from services.live.streaming.yuv_planes import plane_rows

COLUMNS, ROWS = 10, 2
_BITS = np.arange(15, -1, -1)
_GREY = 128


class LatencyCode(Instrumentation):
    """Marks what viewers receive with the capture time of the newest keypoints in it."""

    def stamp_ms(self, room: Room) -> float | None:
        """That of the newest keypoints; None where nobody is driven live."""
        return _newest_capture_ms(room)

    def pose_time_ms(self, room: Room, now_s: float) -> float:
        """The capture time of the newest keypoints, by the camera's clock; else the time now."""
        captured_ms = _newest_capture_ms(room)
        return super().pose_time_ms(room, now_s) if captured_ms is None else captured_ms


def _newest_capture_ms(room: Room) -> float | None:
    times = [motion.captured_ms for motion in list(room.live_motions.values())]
    return max((ms for ms in times if ms is not None), default=None)


def cells(captured_ms: float) -> Bool[Array, "2 10"]:
    """The code of a capture time; True is white."""
    value = int(captured_ms) % 65536
    nibbles = sum((value >> shift) & 15 for shift in (0, 4, 8, 12))
    check = (nibbles + 5) & 15  # neither an all-black nor an all-white corner is a code
    bits = np.concatenate([(value >> _BITS) & 1, (check >> _BITS[12:]) & 1])
    return bits.astype(bool).reshape(ROWS, COLUMNS)


def write(frame: VideoFrame, captured_ms: float) -> None:
    """Write the code into a yuv420p frame of at least 160 x 32 px."""
    luma, blue, red = (plane_rows(plane) for plane in frame.planes)
    height, width = ROWS * CELL_PX, COLUMNS * CELL_PX
    luma[:height, :width] = draw_cells(cells(captured_ms))
    blue[: height // 2, : width // 2] = red[: height // 2, : width // 2] = _GREY


def read(luma: UInt8[Array, "H W"]) -> int | None:
    """The capture time in ms, modulo 65,536, that a picture shows; None where there is no code."""
    shown = read_cells(luma, ROWS, COLUMNS)
    value = int((shown.ravel()[:16].astype(int) << _BITS).sum())
    return value if (cells(value) == shown).all() else None
