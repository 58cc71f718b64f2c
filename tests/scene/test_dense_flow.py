"""Flow of pictures so small or so narrow that OpenCV's own search reads beyond them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from scene.dense_flow import dense_flow

PRESETS = (cv2.DISOPTICAL_FLOW_PRESET_FAST, cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
SIZES = ((1, 1), (1, 400), (8, 48), (10, 300), (15, 60), (30, 300), (31, 1000), (300, 10))


def noise(height: int, width: int) -> np.ndarray:
    rng = np.random.default_rng(height + width)
    return cv2.GaussianBlur(rng.integers(0, 256, (height, width), np.uint8), (0, 0), 1.5)


def nothing(height: int, width: int) -> np.ndarray:
    return np.zeros((height, width, 2), np.float32)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("size", SIZES)
def test_no_picture_is_too_small(preset: int, size: tuple[int, int]):
    search, picture = cv2.DISOpticalFlow.create(preset), noise(*size)
    flow = dense_flow(search, picture, picture[::-1].copy(), nothing(*size))
    assert flow.shape == (*size, 2)
    assert np.isfinite(flow).all()


@pytest.mark.parametrize("preset", PRESETS)
def test_a_small_picture_is_seen_to_move_as_it_did(preset: int):
    wide = noise(20, 100)
    first, second = (np.ascontiguousarray(wide[:, start : start + 80]) for start in (10, 8))
    flow = dense_flow(cv2.DISOpticalFlow.create(preset), first, second, nothing(20, 80))
    assert np.median(flow[..., 0]) == pytest.approx(2.0, abs=0.3)
    assert np.median(flow[..., 1]) == pytest.approx(0.0, abs=0.3)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_larger_picture_is_left_to_opencv_whatever_came_before(preset: int):
    first, second = noise(64, 90), noise(90, 64).T.copy()
    search, fresh = (cv2.DISOpticalFlow.create(preset) for _ in range(2))
    dense_flow(search, noise(20, 40), noise(20, 40), nothing(20, 40))
    flow = dense_flow(search, first, second, nothing(64, 90))
    np.testing.assert_array_equal(flow, fresh.calc(first, second, nothing(64, 90)))
