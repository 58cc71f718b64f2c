"""Damped Gauss-Newton (Levenberg-Marquardt) on one frame: steps from a pose to a better one."""

from __future__ import annotations

import math

import numba
import numpy as np

from capture.live.energy_kernels import (
    JOINTS,
    UNKNOWNS,
    FrameObservation,
    SolverModel,
    landmark_positions,
    pose_equations,
)
from scene.arrays import Array
from scene.kinematics_kernels import (
    axis_angles_to_matrices,
    forward_kinematics,
    matrices_to_axis_angles,
    multiply,
    multiply_transposed,
    write_rotation,
)


@numba.njit(cache=True)
def damped_step(normal: Array, right: Array, damping: float, floor: float, step: Array) -> None:
    """Solve (N + damping diag N + floor) step = right by Cholesky, into `step` [75].

    LAPACK would do as well, but its threads wait for each other on a busy machine.
    """
    size = len(right)
    lower = np.zeros((size, size))
    for i in range(size):
        for j in range(i + 1):
            total = normal[i, j]
            if i == j:
                total += damping * normal[i, i] + floor
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(max(total, floor)) if i == j else total / lower[j, j]
    for i in range(size):
        total = right[i]
        for k in range(i):
            total -= lower[i, k] * step[k]
        step[i] = total / lower[i, i]
    for i in range(size - 1, -1, -1):
        total = step[i]
        for k in range(i + 1, size):
            total -= lower[k, i] * step[k]
        step[i] = total / lower[i, i]


@numba.njit(cache=True)
def apply_pose_step(local: Array, global_rotations: Array, parents: Array, step: Array) -> Array:
    """Local rotations [24 3 3] after those of `step` [75] about world axes: W^T exp(d) W L."""
    out, rotation, product = np.empty(local.shape), np.empty((3, 3)), np.empty((3, 3))
    for k in range(JOINTS):
        write_rotation(step[3 * k], step[3 * k + 1], step[3 * k + 2], rotation)
        if k == 0:
            multiply(rotation, local[0], out[0])
            continue
        parent_rotation = global_rotations[parents[k]]
        multiply(rotation, parent_rotation, product)
        multiply_transposed(parent_rotation, product, rotation)
        multiply(rotation, local[k], out[k])
    return out


@numba.njit(cache=True, nogil=True)
def gauss_newton(
    local: Array,  # [24 3 3]
    pelvis: Array,  # [3]
    model: SolverModel,
    observation: FrameObservation,
    steps: int,
    precision: Array,  # [75]: 1 / deviation^2 of each unknown about the start
    damping: float,  # share of the diagonal that is added
    floor: float,
) -> tuple[Array, Array, float]:
    """Local rotations, the pelvis' position and the energy after damped Gauss-Newton steps.

    The 3D landmarks are scaled to the size of the body at the start.
    """
    global_rotations, normal, right = np.empty((JOINTS, 3, 3)), np.empty((75, 75)), np.empty(75)
    new_rotations, new_normal, new_right = global_rotations.copy(), normal.copy(), right.copy()
    world = observation.world * _landmark_scale(local, model, observation)
    energy = pose_equations(
        local, pelvis, model, observation, world, global_rotations, normal, right
    )
    offset, step, cost = np.zeros(UNKNOWNS), np.empty(UNKNOWNS), energy
    for _ in range(steps):
        regularised_right, regularised_normal = right.copy(), normal.copy()
        for i in range(UNKNOWNS):
            regularised_right[i] -= 0.5 * precision[i] * offset[i]
            regularised_normal[i, i] += 0.5 * precision[i]
        damped_step(regularised_normal, regularised_right, damping, floor, step)
        new_local = apply_pose_step(local, global_rotations, model.parents, step)
        new_pelvis = pelvis + step[3 * JOINTS :]
        new_energy = pose_equations(
            new_local, new_pelvis, model, observation, world, new_rotations, new_normal, new_right
        )
        new_offset, new_cost = offset + step, new_energy
        for i in range(UNKNOWNS):
            new_cost += 0.5 * precision[i] * new_offset[i] * new_offset[i]
        if new_cost < cost:
            local, pelvis, energy, offset, cost = (
                new_local,
                new_pelvis,
                new_energy,
                new_offset,
                new_cost,
            )
            global_rotations, new_rotations = new_rotations, global_rotations
            normal, new_normal = new_normal, normal
            right, new_right = new_right, right
            damping *= 0.1
        else:
            damping *= 10.0
    # products of rotations drift off SO(3), frame after frame, unless they are normalised
    return axis_angles_to_matrices(matrices_to_axis_angles(local)), pelvis, energy


@numba.njit(cache=True)
def body_landmarks(local: Array, model: SolverModel) -> Array:
    """The landmarks [33 3] of the body whose pelvis is at the origin."""
    global_rotations, positions = np.empty((JOINTS, 3, 3)), np.empty((JOINTS, 3))
    forward_kinematics(local, np.zeros(3), model.rest, model.parents, global_rotations, positions)
    return landmark_positions(
        global_rotations, positions, model.rest, model.landmarks, model.joints
    )


@numba.njit(cache=True)
def _landmark_scale(local: Array, model: SolverModel, observation: FrameObservation) -> float:
    """Scale of the body over that of the 3D landmarks, by least squares in this pose."""
    points = body_landmarks(local, model)
    hips_centre = 0.5 * (points[model.hips[0]] + points[model.hips[1]])
    product, square = 0.0, 0.0
    for m in range(len(points)):
        for c in range(3):
            product += (
                observation.weights[m] * (points[m, c] - hips_centre[c]) * observation.world[m, c]
            )
            square += observation.weights[m] * observation.world[m, c] ** 2
    return product / square
