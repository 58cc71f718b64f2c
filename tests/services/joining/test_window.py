"""The square that is sent: the page's own, to the pixel."""

from __future__ import annotations

import numpy as np

from services.joining.window import LookWindow
from tests.services.joining.people import HANDS_UP, PLACES, SIZE, somebody

GOLDEN = [
    (0, {}),
    (33, HANDS_UP),
    (66, {}),
    (900, {}),
    (1100, {}),
    (1133, {number: (x - 150, y) for number, (x, y) in PLACES.items()}),
]


def test_squares_are_those_of_the_page():
    window = LookWindow()
    squares = [window.follow(somebody(moved), SIZE, time_ms) for time_ms, moved in GOLDEN]
    # the same as in client/tests/look/window.test.ts
    assert squares == [
        (80, 0, 480),
        (-48, -128, 736),
        (-48, -128, 736),
        (-48, -128, 736),
        (80, 0, 480),
        (0, 0, 480),
    ]


def test_a_square_stands_still_while_somebody_hardly_moves():
    window = LookWindow()
    first = window.follow(somebody(), SIZE, 0.0)
    for step in range(1, 60):
        way = 6.0 * np.sin(step), 5.0 * np.cos(1.7 * step)
        moved = {number: (x + way[0], y + way[1]) for number, (x, y) in PLACES.items()}
        assert window.follow(somebody(moved), SIZE, 33.0 * step) == first


def test_there_is_none_while_nobodys_upper_body_is_seen():
    nobody = somebody()
    nobody.visibility[:] = 0.2
    assert LookWindow().follow(nobody, SIZE, 0.0) is None
