"""Which square of a webcam's picture is sent for live look: round head, trunk and hands, and still
while they hardly move.

The page's twin is client/src/look/window.ts; tests hold both to the same squares.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from capture.detection.landmarks import Landmarks
from scene.arrays import Array, Float

_UPPER_BODY = 25
"""Landmarks from the nose to the hips."""
_TRUNK = [
    LANDMARK_NAMES.index(f"{side}_{part}")
    for side in ("left", "right")
    for part in ("shoulder", "hip")
]
"""Where they are hidden, a desk or the picture's edge cuts the trunk off below."""
_SEEN = 0.5
_ABOVE_EYES = 0.9
"""Hair begins so far above the eyes, in the extent of the face's landmarks."""
_MARGIN = 0.06
"""Sleeves, fingers and hair beyond the landmarks, in the larger side of their box."""
_ROOM = 1.15
"""A new square leaves so much room that the next one is not needed soon."""
_LOOSE, _LOOSE_MS = 0.75, 1000.0
"""A square that could be smaller than this share of its side, for so long, is made smaller."""
_SIDE_STEP, _PLACE_STEP = 32, 8
"""px."""


class Square(NamedTuple):
    """Of a picture, px; it may reach beyond."""

    x: int
    y: int
    side: int


class _Box(NamedTuple):
    left: float
    top: float
    right: float
    bottom: float


class LookWindow:
    """Follows one person from picture to picture."""

    def __init__(self) -> None:
        self._square: Square | None = None
        self._loose_since_ms: float | None = None

    def follow(self, seen: Landmarks, size: tuple[int, int], time_ms: float) -> Square | None:
        """The square for the picture of `time_ms`, whose width and height are `size` (px); None
        while nothing of an upper body is seen."""
        box = _box_of(seen, size)
        if box is None:
            return None
        following, held = _square_around(box, size), self._square
        is_loose = held is not None and following.side < _LOOSE * held.side
        since_ms = time_ms if self._loose_since_ms is None else self._loose_since_ms
        self._loose_since_ms = since_ms if is_loose else None
        too_loose = is_loose and time_ms - since_ms >= _LOOSE_MS
        if held is not None and _holds(held, box) and not too_loose:
            return held
        self._loose_since_ms = None
        self._square = following
        return following


def _box_of(seen: Landmarks, size: tuple[int, int]) -> _Box | None:
    """What of the picture shows head, trunk and hands."""
    width, height = size
    points, visible = seen.pixels[:_UPPER_BODY], seen.visibility[:_UPPER_BODY] >= _SEEN
    shown = visible & ((points >= 0.0) & (points <= size)).all(axis=1)
    shown[_TRUNK] = True
    if not (shown & visible).any():
        return None
    box = _extent(points[shown])
    face = points[:FACE_LANDMARKS][shown[:FACE_LANDMARKS]]
    if len(face):
        head = _extent(face)
        hair = head.top - _ABOVE_EYES * max(head.right - head.left, head.bottom - head.top)
        box = box._replace(top=min(box.top, hair))
    margin = _MARGIN * max(box.right - box.left, box.bottom - box.top)
    return _Box(
        _clamped(box.left - margin, 0.0, width),
        _clamped(box.top - margin, 0.0, height),
        _clamped(box.right + margin, 0.0, width),
        _clamped(box.bottom + margin, 0.0, height),
    )


def _extent(points: Float[Array, "N 2"]) -> _Box:
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    return _Box(float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _square_around(box: _Box, size: tuple[int, int]) -> Square:
    needed = max(box.right - box.left, box.bottom - box.top, 1.0)
    roomy = _SIDE_STEP * math.ceil(_ROOM * needed / _SIDE_STEP)
    # beyond the picture there is nothing to have room for
    side = min(roomy, *size) if needed <= min(size) else roomy
    middle = 0.5 * (box.left + box.right), 0.5 * (box.top + box.bottom)
    return Square(_placed(middle[0], side, size[0]), _placed(middle[1], side, size[1]), side)


def _placed(middle: float, side: int, most: int) -> int:
    """Where a square about `middle` begins: inside of the picture where it fits, else about it."""
    fits = side <= most
    start = _clamped(middle - side / 2, 0, most - side) if fits else (most - side) / 2
    return _PLACE_STEP * math.floor(start / _PLACE_STEP)


def _holds(square: Square, box: _Box) -> bool:
    x, y, side = square
    return box.left >= x and box.top >= y and box.right <= x + side and box.bottom <= y + side


def _clamped(value: float, low: float, high: float) -> float:
    return max(low, min(high, value))
