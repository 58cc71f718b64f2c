"""The analytic equations of the live solver, against differences of the energy itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from capture.body.pose_prior import pose_prior
from capture.live.energy_kernels import UNKNOWNS, pose_equations, prior_equations
from capture.live.filter_kernels import filter_rotations
from capture.live.gauss_newton_kernels import body_landmarks, gauss_newton
from capture.live.solver import STEPS, frame_observation, solver_model
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_COUNT, PARENTS
from tests.capture.people import body, camera, seen_by, standing


@pytest.fixture(scope="module")
def problem():
    motion = standing(6, turn_rad=0.8)
    person = seen_by(camera(), body(), motion.pose(2))
    away = motion.pose(4)  # a pose near the true one
    local = axis_angle_to_matrix(away.joint_angles)
    pelvis = away.root_translation + body().skeleton.rest_joints[0] + [0.02, -0.01, 0.03]
    return solver_model(body(), camera()), frame_observation(person, camera()), local, pelvis


def equations(model, seen, local, pelvis):
    """Energy, normal matrix, right side and global rotations."""
    global_rotations, normal = np.empty((JOINT_COUNT, 3, 3)), np.empty((UNKNOWNS, UNKNOWNS))
    right = np.empty(UNKNOWNS)
    energy = pose_equations(local, pelvis, model, seen, seen.world, global_rotations, normal, right)
    return energy, normal, right, global_rotations


def moved(local, pelvis, global_rotations, step):
    """Local rotations and pelvis after the step `step` [75] in world axes."""
    rotations = axis_angle_to_matrix(step[:-3].reshape(JOINT_COUNT, 3))
    above = np.concatenate([np.eye(3)[None], global_rotations[np.array(PARENTS[1:])]])
    return np.swapaxes(above, -1, -2) @ rotations @ above @ local, pelvis + step[-3:]


def test_the_gradient_is_that_of_the_energy(problem):
    model, seen, local, pelvis = problem
    _, _, right, global_rotations = equations(*problem)
    numeric = np.zeros(UNKNOWNS)
    for i in range(UNKNOWNS):
        ends = []
        for sign in (1.0, -1.0):
            step = np.zeros(UNKNOWNS)
            step[i] = sign * 1e-5
            ends.append(equations(model, seen, *moved(local, pelvis, global_rotations, step))[0])
        numeric[i] = (ends[0] - ends[1]) / 2e-5
    # right = -J^T r, and the energy's slope is twice J^T r
    np.testing.assert_allclose(-2.0 * right, numeric, rtol=2e-4, atol=2e-3)


def test_the_normal_matrix_is_symmetric_and_positive(problem):
    normal = equations(*problem)[1]
    np.testing.assert_allclose(normal, normal.T, rtol=1e-9, atol=1e-6)
    assert np.linalg.eigvalsh(normal).min() > -1e-6


def test_the_way_down_is_that_of_its_plain_twin(problem):
    """Damped Gauss-Newton in numpy, with LAPACK's solution of each step."""
    model, seen, local, pelvis = problem
    pull = np.linspace(0.5, 200.0, UNKNOWNS)
    points = body_landmarks(local, model)
    ours, weight = points - points[model.hips].mean(axis=0), seen.weights[:, None]
    size = (weight * ours * seen.world).sum() / (weight * seen.world**2).sum()
    sized = seen._replace(world=size * seen.world)
    found, at, damping, gone = local, pelvis, 1e-2, np.zeros(UNKNOWNS)
    energy, normal, right, global_rotations = equations(model, sized, found, at)
    cost = energy
    for _ in range(4):
        matrix = normal + np.diag(0.5 * pull)
        matrix += np.diag(damping * np.diag(matrix) + 1e-6)
        step = np.linalg.solve(matrix, right - 0.5 * pull * gone)
        new_local, new_at = moved(found, at, global_rotations, step)
        next_ones = equations(model, sized, new_local, new_at)
        total = next_ones[0] + 0.5 * pull @ (gone + step) ** 2
        if total < cost:
            energy, normal, right, global_rotations = next_ones
            found, at, gone, cost, damping = new_local, new_at, gone + step, total, 0.1 * damping
        else:
            damping *= 10.0
    rotations, place, left = gauss_newton(local, pelvis, model, seen, 4, pull, 1e-2, 1e-6)
    np.testing.assert_allclose(rotations, found, atol=1e-8)
    np.testing.assert_allclose(place, at, atol=1e-8)
    assert left == pytest.approx(energy)
    assert left < 0.5 * equations(model, sized, local, pelvis)[0]


def test_turns_stay_turns_however_long_somebody_is_followed():
    """Hands, which little is seen of, are turned a bit by every frame."""
    rng, motion, frames = np.random.default_rng(4), standing(6, turn_rad=0.8), 59
    people = [seen_by(camera(), body(), motion.pose(frame)) for frame in range(len(motion))]
    model, pull = solver_model(body(), camera()), np.full(UNKNOWNS, 100.0)
    local = axis_angle_to_matrix(motion.joint_angles[0])
    pelvis = motion.root_translation[0] + body().skeleton.rest_joints[0]
    for frame in range(frames):
        person = people[frame % 6 if frame // 6 % 2 == 0 else -1 - frame % 6]
        noisy = replace(person, world=person.world + rng.normal(0.0, 0.01, (33, 3)))
        seen = frame_observation(noisy, camera())
        local, pelvis, _ = gauss_newton(local, pelvis, model, seen, STEPS, pull, 1e-2, 1e-6)
    apart = np.swapaxes(local, 1, 2) @ local - np.eye(3)
    assert np.abs(apart).max() < 1e-9


def test_the_filter_is_that_of_its_plain_twin():
    rng = np.random.default_rng(3)
    before, seen, shown = (
        axis_angle_to_matrix(rng.normal(0.0, 0.5, (JOINT_COUNT, 3))) for _ in range(3)
    )
    angular_velocity, step_s = rng.normal(size=(JOINT_COUNT, 3)), 0.04

    def between(start, end):
        return matrix_to_axis_angle(np.swapaxes(start, -1, -2) @ end)

    def share(cutoff_hz):
        return 1.0 / (1.0 + 1.0 / (2.0 * np.pi * cutoff_hz * step_s))

    pace = angular_velocity + share(1.2) * (between(before, seen) / step_s - angular_velocity)
    own = share(1.5 + 0.7 * np.linalg.norm(pace, axis=1))[:, None]
    wanted = shown @ axis_angle_to_matrix(own * between(shown, seen))
    filter_rotations(shown, angular_velocity, before, seen, step_s, 1.2, 1.5, 0.7)
    np.testing.assert_allclose(shown, wanted, atol=1e-12)
    np.testing.assert_allclose(angular_velocity, pace, atol=1e-12)


def test_the_prior_has_its_least_at_the_mean():
    prior = pose_prior()
    mean, axes = prior.mean.numpy().astype(float), prior.axes.numpy().astype(float)
    stiffness = prior.deviation.numpy().astype(float) ** -2
    global_rotations = np.tile(np.eye(3), (JOINT_COUNT, 1, 1))
    normal, right = np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros(UNKNOWNS)
    angles = matrix_to_axis_angle(axis_angle_to_matrix(mean))
    energy = prior_equations(
        global_rotations, np.array(PARENTS), angles, mean, axes, stiffness, normal, right
    )
    assert energy == pytest.approx(0.0, abs=1e-9)
    assert np.abs(right).max() < 1e-4
    assert (np.diag(normal)[3:-3] > 0.0).all()
