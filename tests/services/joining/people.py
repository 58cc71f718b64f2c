"""Somebody at a desk, as client/tests/look/window.test.ts has them."""

from __future__ import annotations

import numpy as np

from capture.detection.landmarks import Landmarks

SIZE = (640, 480)
PLACES = {
    0: (320, 150),
    7: (350, 145),
    8: (290, 145),
    11: (400, 260),
    12: (240, 260),
    13: (430, 400),
    14: (210, 400),
    15: (420, 540),
    16: (220, 540),
    23: (370, 620),
    24: (270, 620),
}
"""px of nose, ears, shoulders and elbows; hips and wrists are below the picture."""
HANDS_UP = {15: (610, 120), 19: (625, 100), 16: (30, 120), 20: (20, 100)}


def somebody(moved: dict[int, tuple[float, float]] | None = None) -> Landmarks:
    """With some landmarks elsewhere; those that are not given are not seen. The mask is a box."""
    pixels, visibility = np.full((33, 2), -1.0) * SIZE, np.zeros(33)
    for number, place in (PLACES | (moved or {})).items():
        pixels[number] = place
        visibility[number] = 1.0 if place[1] <= SIZE[1] else 0.1
    mask = np.zeros(SIZE[::-1], np.float32)
    mask[100:, 200:440] = 1.0
    return Landmarks(pixels, np.zeros((33, 3)), visibility, mask)
