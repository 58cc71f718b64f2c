"""Clips come back from a codec as they went in, but for what its bits are too few for."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stability.video import through_h264


def clip(high: int, wide: int, frames: int = 12) -> list[np.ndarray]:
    """A bright box that moves over a slope."""
    slope = np.linspace(0.2, 0.6, wide)[None, :, None] * np.ones((high, 1, 3))
    pictures = []
    for index in range(frames):
        picture = slope.copy()
        picture[10:30, 5 + 2 * index : 25 + 2 * index] = (0.8, 0.5, 0.3)
        pictures.append(picture.astype(np.float32))
    return pictures


@pytest.mark.parametrize("size", [(64, 80), (63, 81)])
def test_pictures_of_any_size_come_back_in_order(size: tuple[int, int]):
    pictures = clip(*size)
    back = through_h264(pictures, 4.0)
    assert len(back) == len(pictures)
    for before, after in zip(pictures, back, strict=True):
        assert after.shape == before.shape
        assert np.abs(after - before).mean() < 0.01


def test_the_same_bits_are_the_same_pictures():
    once, *others = (through_h264(clip(64, 80), 0.2) for _ in range(8))
    for again in others:
        np.testing.assert_array_equal(once, again)
