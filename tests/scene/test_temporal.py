"""Second differences: of a parabola, their transpose, and what small turns do to them."""

from __future__ import annotations

import numpy as np
import pytest

from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.temporal import Accelerations

TIMES_S = np.array([0.0, 0.1, 0.15, 0.3, 0.4, 0.5])


def test_a_parabola_accelerates_evenly_at_uneven_times():
    found = Accelerations.of(TIMES_S)(3.0 * TIMES_S[:, None] ** 2)
    np.testing.assert_allclose(found[1:-1], 6.0, atol=1e-9)
    assert (found[[0, -1]] == 0.0).all()


def test_the_transpose_is_the_transpose():
    operator, rng = Accelerations.of(TIMES_S), np.random.default_rng(0)
    x, y = rng.normal(size=(2, len(TIMES_S), 4))
    assert (operator(x) * y).sum() == pytest.approx((x * operator.transposed(y)).sum())


def test_the_diagonal_is_that_of_the_squared_operator():
    operator, frames = Accelerations.of(TIMES_S), len(TIMES_S)
    weights = np.random.default_rng(0).uniform(size=(frames, 1))
    dense = operator(np.eye(frames))
    expected = np.diag(dense.T @ (weights * dense))
    np.testing.assert_allclose(operator.diagonal(weights)[:, 0], expected)


def test_turns_change_accelerations_as_the_operator_says():
    operator, rng = Accelerations.of(TIMES_S), np.random.default_rng(0)
    angles = np.array([0.3, -0.2, 0.4]) + 0.05 * rng.normal(size=(len(TIMES_S), 1, 3))
    turns, step = rng.normal(size=angles.shape), 1e-5

    def moved(share: float) -> np.ndarray:
        turned = axis_angle_to_matrix(angles) @ axis_angle_to_matrix(share * turns)
        return operator.of_rotations(matrix_to_axis_angle(turned))

    difference = (moved(step) - moved(-step)) / (2.0 * step)
    expected = operator(turns.reshape(len(TIMES_S), -1)).reshape(angles.shape)
    # exact for motion along one axis, else off by half of what the joint turns between two frames
    assert np.abs(difference - expected).max() < 0.1 * np.abs(expected).max()
