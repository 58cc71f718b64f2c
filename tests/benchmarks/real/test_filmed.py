"""From a stored crop back to the whole picture, and what was trained on kept apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.real.filmed import require_unseen, whole_camera
from scene.camera import Camera, look_at
from scene.errors import InvalidInput


@given(
    x=st.integers(0, 300),
    y=st.integers(0, 200),
    width=st.integers(150, 700),
    height=st.integers(150, 500),
    shrink=st.floats(0.3, 1.0),
    focal_px=st.floats(300.0, 2000.0),
)
def test_the_whole_camera_is_found_from_its_crop(x, y, width, height, shrink, focal_px):
    intrinsics = np.array([[focal_px, 0.0, 640.0], [0.0, focal_px, 360.0], [0.0, 0.0, 1.0]])
    whole = Camera(intrinsics, look_at([0.3, 1.2, 3.0], [0.0, 1.0, 0.0]), 1280, 720)
    size = max(1, round(shrink * width)), max(1, round(shrink * height))
    stored = whole.cropped(x, y, width, height).resized(*size)
    found = whole_camera(stored, focal_px, (1280, 720))
    assert (found.width, found.height) == (1280, 720)
    np.testing.assert_allclose(found.intrinsics, whole.intrinsics, atol=1e-6)


def test_a_test_frame_that_was_trained_on_is_refused():
    pictures = list(np.random.default_rng(0).integers(0, 255, (4, 8, 8, 3), np.uint8))
    require_unseen(pictures[:2], pictures[2:])
    with pytest.raises(InvalidInput, match=r"not have been trained on; got 1.*test frame 1"):
        require_unseen(pictures[:2], [pictures[2], pictures[1].copy()])
