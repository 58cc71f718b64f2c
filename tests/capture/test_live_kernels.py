"""The analytic equations of the live solver, against differences of the energy itself."""

from __future__ import annotations

import numpy as np
import pytest

from capture.fit_terms import pose_prior
from capture.live import LiveSolver
from capture.live_kernels import UNKNOWNS, prior_equations
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_COUNT, PARENTS
from tests.capture.people import body, camera, seen_by, standing


@pytest.fixture(scope="module")
def problem():
    motion = standing(6, turn_rad=0.8)
    solver = LiveSolver(body(), camera(), smoothing=None)
    person = seen_by(camera(), body(), motion.pose(2))
    seen = solver._prepared(person)
    away = motion.pose(4)  # a pose near the true one
    local = axis_angle_to_matrix(away.joint_angles)
    pelvis = away.root_translation + body().skeleton.rest_joints[0] + [0.02, -0.01, 0.03]
    return solver, solver._sized(seen, local), local, pelvis


def moved(local, pelvis, turned, step):
    """Local turns and pelvis after the step `step` [75] in world axes."""
    turns = axis_angle_to_matrix(step[:-3].reshape(JOINT_COUNT, 3))
    above = np.concatenate([np.eye(3)[None], turned[np.array(PARENTS[1:])]])
    return np.swapaxes(above, -1, -2) @ turns @ above @ local, pelvis + step[-3:]


def test_the_gradient_is_that_of_the_energy(problem):
    solver, seen, local, pelvis = problem
    state = solver._state(local, pelvis, seen)
    numeric = np.zeros(UNKNOWNS)
    for i in range(UNKNOWNS):
        ends = []
        for sign in (1.0, -1.0):
            step = np.zeros(UNKNOWNS)
            step[i] = sign * 1e-5
            ends.append(solver._state(*moved(local, pelvis, state.turned, step), seen).energy)
        numeric[i] = (ends[0] - ends[1]) / 2e-5
    # right = -J^T r, and the energy's slope is twice J^T r
    np.testing.assert_allclose(-2.0 * state.right, numeric, rtol=2e-4, atol=2e-3)


def test_the_normal_matrix_is_symmetric_and_positive(problem):
    solver, seen, local, pelvis = problem
    normal = solver._state(local, pelvis, seen).normal
    np.testing.assert_allclose(normal, normal.T, rtol=1e-9, atol=1e-6)
    assert np.linalg.eigvalsh(normal).min() > -1e-6


def test_the_prior_has_its_least_at_the_mean():
    prior = pose_prior()
    mean, axes = prior.mean.numpy().astype(float), prior.axes.numpy().astype(float)
    stiffness = prior.deviation.numpy().astype(float) ** -2
    turned = np.tile(np.eye(3), (JOINT_COUNT, 1, 1))
    normal, right = np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros(UNKNOWNS)
    angles = matrix_to_axis_angle(axis_angle_to_matrix(mean))
    energy = prior_equations(
        turned, np.array(PARENTS), angles, mean, axes, stiffness, normal, right
    )
    assert energy == pytest.approx(0.0, abs=1e-9)
    assert np.abs(right).max() < 1e-4
    assert (np.diag(normal)[3:-3] > 0.0).all()
