"""What a capture is given in place of what the estimator found."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from benchmarks.stability.footage import outlined
from capture.detection.landmarks import Landmarks

RADIUS = 20


@pytest.mark.parametrize("px", [-4.0, -1.0, 0.0, 2.0, 8.0])
def test_an_outline_moves_by_as_much_as_said(px: float):
    mask = np.zeros((80, 80), np.float32)
    cv2.circle(mask, (40, 40), RADIUS, 1.0, -1)
    seen = Landmarks(np.zeros((33, 2)), np.zeros((33, 3)), np.ones(33), mask)
    moved = outlined(px)(seen, np.random.default_rng(0))
    assert moved.mask.dtype == np.float32
    # of a disc of that radius
    assert np.sqrt(moved.mask.sum() / np.pi) == pytest.approx(RADIUS + px, abs=0.7)
    assert moved.visibility is seen.visibility
