"""The planes against BT.601 written out, and against what libswscale makes of the same picture."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from av import VideoFrame

from renderer.compositing.yuv_kernels import to_yuv420


def _planes(rgb: np.ndarray, padding: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    height, width = rgb.shape[:2]
    luma = np.full((height, width + padding), 7, np.uint8)
    blue = np.full((height // 2, width // 2 + padding), 7, np.uint8)
    red = blue.copy()
    everywhere = np.ones((-(-height // 16), -(-width // 16)), bool)
    to_yuv420(rgb, everywhere, luma, blue, red)
    return luma, blue, red


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    rng = np.random.default_rng(3)
    coarse = rng.uniform(0.0, 255.0, (6, 8, 3))
    smooth = np.kron(coarse, np.ones((8, 8, 1))) + rng.uniform(-4.0, 4.0, (48, 64, 3))
    return np.clip(smooth, 0.0, 255.0).astype(np.uint8)


def test_is_bt601_in_limited_range(picture):
    r, g, b = np.moveaxis(picture.astype(np.float64) / 255.0, -1, 0)
    luma, blue, red = _planes(picture)
    assert np.abs(luma - (16.0 + 65.481 * r + 128.553 * g + 24.966 * b)).max() <= 1.5
    mean = [c.reshape(24, 2, 32, 2).mean(axis=(1, 3)) for c in (r, g, b)]
    wanted = 128.0 - 37.797 * mean[0] - 74.203 * mean[1] + 112.0 * mean[2]
    assert np.abs(blue - wanted).max() <= 1.5
    wanted = 128.0 + 112.0 * mean[0] - 93.786 * mean[1] - 18.214 * mean[2]
    assert np.abs(red - wanted).max() <= 1.5


@pytest.mark.parametrize("colour", [(0, 0, 0), (255, 255, 255), (255, 0, 0), (0, 0, 255)])
def test_extremes_stay_within_the_range(colour):
    luma, blue, red = _planes(np.full((4, 4, 3), colour, np.uint8))
    assert 16 <= luma.min() <= luma.max() <= 235
    assert 16 <= min(blue.min(), red.min()) <= max(blue.max(), red.max()) <= 240


def test_agrees_with_libswscale():
    # even patches: of what lies between, libswscale takes its own samples
    colours = np.random.default_rng(4).integers(0, 256, (3, 4, 3), np.uint8)
    picture = np.kron(colours, np.ones((16, 16, 1), np.uint8))
    theirs = VideoFrame.from_ndarray(picture, format="rgb24").reformat(format="yuv420p")
    for ours, plane in zip(_planes(picture), theirs.planes, strict=True):
        rows = np.frombuffer(cast(memoryview, plane), np.uint8).reshape(
            plane.height, plane.line_size
        )
        middle = slice(4, None, 16 * plane.height // 48)
        apart = ours[middle].astype(int) - rows[middle, : plane.width].astype(int)
        assert np.median(np.abs(apart)) <= 1.0
        assert np.abs(apart[:, :: plane.width // 4][:, 1:]).max() <= 3


def test_what_lies_beyond_the_picture_is_left_alone(picture):
    for plane in _planes(picture, padding=16):
        assert (plane[:, -16:] == 7).all()
