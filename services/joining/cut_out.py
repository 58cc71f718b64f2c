"""Draws what leaves the device for live look: the person cut out, and the code.

The page's twins are client/src/look/cutOut.ts and matte.ts; `services.live.look.receiver` reads it.
"""

from __future__ import annotations

import cv2
import numpy as np

from capture.detection.landmarks import Landmarks
from scene.arrays import Array, Float, UInt8
from services.joining.window import LookWindow, Square
from services.live.cell_code import draw_cells
from services.live.look.keying import lifted
from services.live.look.picture_code import SIDE_PX, PictureCode, cells_of
from services.live.look.receiver import FRAME_SIZE, PICTURE_PX
from services.live.motion.live_motion import CAPTURE_TIMES

_LEAST = 0.1
"""Of a network's mask: less is not the person, and nothing of it leaves the device."""
_LEAST_MS = 75.0
"""Between pictures: ten a second are sent, of a camera's thirty every third. Each has half as many
bits again as of fifteen."""
_MIDDLE_GREY = 128
MATTE_PX = PICTURE_PX // 2
"""Of a side: a network's mask is no finer."""


class CutOut:
    """Cuts one person out of picture after picture."""

    def __init__(self) -> None:
        self._window = LookWindow()
        self._drawn_ms = -np.inf

    def draw(
        self, image: UInt8[Array, "H W 3"], seen: Landmarks, time_ms: float
    ) -> UInt8[Array, "528 384 3"] | None:
        """The sRGB picture to send of `image`, captured at `time_ms`.

        None where the person is hardly seen, and where the last one was drawn a moment ago.
        """
        if time_ms - self._drawn_ms < _LEAST_MS:
            return None
        square = self._window.follow(seen, (image.shape[1], image.shape[0]), time_ms)
        if square is None:
            return None
        self._drawn_ms = time_ms
        matte = matte_of(seen.mask, square, MATTE_PX)
        kept = np.minimum(2.0 / 255.0 * matte.astype(np.float32), 1.0)
        kept = cv2.resize(kept, (PICTURE_PX, PICTURE_PX), interpolation=cv2.INTER_LINEAR)
        # exactly nothing where the matte is nought, whatever the pixels beside it are
        kept[np.kron(matte, np.ones((2, 2), np.uint8)) == 0] = 0.0
        width, height = FRAME_SIZE
        frame = np.zeros((height, width, 3), np.uint8)
        frame[:PICTURE_PX] = lifted(_square_of(image, square), kept)
        code = PictureCode(int(time_ms) % CAPTURE_TIMES, *square)
        white = draw_cells(cells_of(code)) > _MIDDLE_GREY
        frame[PICTURE_PX:, :SIDE_PX] = 255 * white[..., None].astype(np.uint8)
        return frame


def matte_of(mask: Float[Array, "H W"], square: Square, side: int) -> UInt8[Array, "S S"]:
    """`side` x `side` numbers, 255 the person, of `square` of the mask's picture; 0 beyond it."""
    height, width = mask.shape
    steps = (np.arange(side) + 0.5) * square.side / side
    rows, columns = (np.floor(at + steps).astype(int) for at in (square.y, square.x))
    matte = mask[np.clip(rows, 0, height - 1)[:, None], np.clip(columns, 0, width - 1)].copy()
    matte[(rows < 0) | (rows >= height)] = 0.0
    matte[:, (columns < 0) | (columns >= width)] = 0.0
    matte[matte < _LEAST] = 0.0
    return np.rint(255.0 * np.clip(matte, 0.0, 1.0)).astype(np.uint8)


def _square_of(image: UInt8[Array, "H W 3"], square: Square) -> UInt8[Array, "384 384 3"]:
    """`square` of the picture at the size that is sent; black beyond the picture."""
    x, y, side = square
    height, width = image.shape[:2]
    whole = np.zeros((side, side, 3), np.uint8)
    top, bottom = max(y, 0), min(y + side, height)
    left, right = max(x, 0), min(x + side, width)
    if top < bottom and left < right:
        whole[top - y : bottom - y, left - x : right - x] = image[top:bottom, left:right]
    way = cv2.INTER_AREA if side > PICTURE_PX else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(whole, (PICTURE_PX, PICTURE_PX), interpolation=way))
