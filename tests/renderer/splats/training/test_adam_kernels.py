"""Adam's steps: as large as what pulls a splat deserves, and only of splats that a frame shows."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, POSITION
from renderer.splats.training.adam_kernels import adam_step

RATE = 1e-3
SCALES = np.log(np.array([1e-3, 1e-1], np.float32))


def stepped(gradient: np.ndarray, seen: float = 1.0) -> np.ndarray:
    """How far the first step moves the parameters of one splat, in rates."""
    parameters = np.full((1, PARAMETERS), 0.5, np.float32)
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = SCALES.mean()
    before, moments = parameters.copy(), np.zeros((2, 1, PARAMETERS), np.float32)
    adam_step(
        parameters,
        gradient[None].astype(np.float32),
        np.full(1, seen, np.float32),
        moments[0],
        moments[1],
        np.zeros(1, np.int32),
        np.full(PARAMETERS, RATE, np.float32),
        0.9,
        0.99,
        0.02,
        SCALES,
    )
    return (before - parameters)[0] / RATE


def test_depth_moves_by_what_pulls_it_and_not_by_noise():
    gradient = np.zeros(PARAMETERS)
    gradient[POSITION : POSITION + 3] = [0.3, -0.06, 0.003]
    moved = stepped(gradient)[POSITION : POSITION + 3]
    np.testing.assert_allclose(moved, [1.0, -0.2, 0.01], atol=2e-3)


def test_a_sliver_hardly_changes_a_colour_and_a_pixel_does():
    gradient = np.zeros(PARAMETERS)
    gradient[COLOUR : COLOUR + 3] = [1e-4, 1e-2, 1.0]
    moved = stepped(gradient)[COLOUR : COLOUR + 3]
    np.testing.assert_allclose(moved, [0.01, 0.5, 0.99], atol=2e-3)


@pytest.mark.parametrize("column", [LOG_SCALE, LOG_SCALE + 4, OPACITY])
def test_of_the_rest_each_column_has_its_own_measure(column):
    gradient = np.zeros(PARAMETERS)
    gradient[LOG_SCALE], gradient[column] = 1.0, 1e-5
    assert stepped(gradient)[column] == pytest.approx(1.0, abs=2e-3)


def test_a_splat_that_no_frame_shows_keeps_still():
    assert not stepped(np.ones(PARAMETERS), seen=0.01).any()
