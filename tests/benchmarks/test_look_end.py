"""When the server's pictures show trained colours again, told from pictures alone."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.look_end import gone_after_ms

OFF_MS, EVERY_MS = 5000.0, 100.0


def shown(gone_ms: float, apart: float) -> list[tuple[float, list[float]]]:
    """Pictures from 3 s before the switch to 3 s after it; the person moves in all of them."""
    noise = np.random.default_rng(3)
    pictures = []
    for time_ms in np.arange(OFF_MS - 3000.0, OFF_MS + 3000.0, EVERY_MS):
        levels = 100.0 + noise.normal(0.0, 4.0, 192)
        levels[:60] += apart * (time_ms >= OFF_MS + gone_ms)
        pictures.append((float(time_ms), levels.tolist()))
    return pictures


def test_the_first_picture_in_trained_colours_is_found():
    assert gone_after_ms(shown(300.0, 20.0), OFF_MS) == 300.0


def test_one_picture_that_resembles_them_is_not_taken_for_the_end():
    pictures = shown(400.0, 20.0)
    at = next(n for n, (time_ms, _) in enumerate(pictures) if time_ms == OFF_MS + 100.0)
    pictures[at] = (OFF_MS + 100.0, pictures[-1][1])
    assert gone_after_ms(pictures, OFF_MS) == 400.0


@pytest.mark.parametrize("pictures", [[], shown(300.0, 0.0), shown(300.0, 20.0)[::12]])
def test_pictures_that_tell_nothing_are_not_counted(pictures):
    assert gone_after_ms(pictures, OFF_MS) is None
