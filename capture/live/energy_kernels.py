"""Energy of a pose under one frame's landmarks and the pose prior, with its normal equations.

Letters: W_k, p_k global rotation and position of joint k; m = p_j + W_j (r - J_j) a landmark that
moves with joint j. A rotation d_k (rad, world axes) of joint k and all beyond it moves every
landmark beyond it by d_k x (m - p_k): that is the whole Jacobian. Unknowns x: d_0 .. d_23, then the
translation of the pelvis: 75 numbers. float64.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from scene.arrays import Array
from scene.kinematics_kernels import (
    forward_kinematics,
    matrices_to_axis_angles,
    multiply,
)

JOINTS = 24
UNKNOWNS = 3 * JOINTS + 3
"""A rotation of each joint and the pelvis' translation."""


class SolverModel(NamedTuple):
    """What is constant over frames: body, camera, prior and weights."""

    rest: Array  # [24 3]
    parents: Array  # [24] int64
    landmarks: Array  # [33 3] rest points of the landmarks
    joints: Array  # [33] int64: the joint of each
    hips: Array  # [2] int64: landmarks whose middle is the origin of the 3D ones
    depth_weights: Array  # [33]
    camera: Array  # [4 4]: rows of R|t, then fx, fy, cx, cy
    per_metre: float  # 1 / deviation of a 3D landmark
    mean: Array  # [24 3]
    axes: Array  # [24 3 3] rows along which `stiffness` counts
    stiffness: Array  # [24 3] 1 / deviation^2


class FrameObservation(NamedTuple):
    """One frame's landmarks."""

    pixels: Array  # [33 2]
    pixel_weights: Array  # [33], at most `weights`
    weights: Array  # [33]
    world: Array  # [33 3] m, from between the hips, world axes
    per_pixel: float  # 1 / deviation of a projected landmark


@numba.njit(inline="always")
def _add(normal, right, columns, rows, count, residual, size, weight):
    """Add `weight` times J^T J and J^T r of one residual of `size` numbers."""
    for a in range(count):
        i = columns[a]
        for s in range(size):
            wa = weight * rows[s, a]
            right[i] -= wa * residual[s]
            for b in range(count):
                normal[i, columns[b]] += wa * rows[s, b]


@numba.njit(inline="always")
def _unknowns_of(joint, parents, columns):
    """The columns of all joints that move `joint`, and their number."""
    count = 0
    while joint >= 0:
        for axis in range(3):
            columns[count] = 3 * joint + axis
            count += 1
        joint = parents[joint]
    return count


@numba.njit(inline="always")
def _rotation_jacobian(rows, columns, count, point, positions):
    """d point / d x of the rotations in `columns`: the columns of -[point - p_k]x."""
    for a in range(0, count, 3):
        k = columns[a] // 3
        x, y, z = (
            point[0] - positions[k, 0],
            point[1] - positions[k, 1],
            point[2] - positions[k, 2],
        )
        rows[0, a], rows[0, a + 1], rows[0, a + 2] = 0.0, z, -y
        rows[1, a], rows[1, a + 1], rows[1, a + 2] = -z, 0.0, x
        rows[2, a], rows[2, a + 1], rows[2, a + 2] = y, -x, 0.0


@numba.njit(cache=True)
def landmark_positions(
    global_rotations: Array, positions: Array, rest: Array, landmarks: Array, joints: Array
) -> Array:
    """Where the landmarks are [33 3], of the rest points `landmarks` [33 3] on `joints` [33]."""
    points = np.empty((len(landmarks), 3))
    for m in range(len(landmarks)):
        j = joints[m]
        for r in range(3):
            points[m, r] = positions[j, r]
            for c in range(3):
                points[m, r] += global_rotations[j, r, c] * (landmarks[m, c] - rest[j, c])
    return points


@numba.njit(cache=True)
def landmark_equations(
    global_rotations: Array,  # [24 3 3]
    positions: Array,  # [24 3]
    rest: Array,  # [24 3]
    parents: Array,  # [24] int64
    landmarks: Array,  # [33 3] rest points
    joints: Array,  # [33] int64: the joint of each
    pixels: Array,  # [33 2]
    pixel_weights: Array,  # [33], at most `weights`
    weights: Array,  # [33]
    depth_weights: Array,  # [33], factor on `weights`
    world: Array,  # [33 3] the estimator's 3D landmarks from between the hips, m, world axes
    hips: Array,  # [2] int64: landmarks whose middle is the origin of `world`
    camera: Array,  # [4 4]: rows of R|t, then fx, fy, cx, cy
    per_pixel: float,  # 1 / deviation of a projected landmark
    per_metre: float,  # 1 / deviation of a 3D landmark
    normal: Array,  # [75 75], added to
    right: Array,  # [75], added to
) -> float:
    """Adds the robust energy of the landmarks, in the picture and in 3D, to the normal
    equations."""
    count_landmarks = len(landmarks)
    points = landmark_positions(global_rotations, positions, rest, landmarks, joints)
    hips_centre = 0.5 * (points[hips[0]] + points[hips[1]])
    columns = np.empty(UNKNOWNS, np.int64)
    rows, image_rows = np.zeros((3, UNKNOWNS)), np.zeros((2, UNKNOWNS))
    residual, residual_3d, p = np.empty(2), np.empty(3), np.empty(3)
    energy = 0.0
    for m in range(count_landmarks):
        if weights[m] <= 0.0:
            continue
        rotations = _unknowns_of(joints[m], parents, columns)
        _rotation_jacobian(rows, columns, rotations, points[m], positions)
        count = rotations
        for axis in range(3):
            columns[count] = 3 * JOINTS + axis
            for r in range(3):
                rows[r, count] = 1.0 if r == axis else 0.0
            count += 1
        for r in range(3):
            p[r] = camera[r, 3]
            for c in range(3):
                p[r] += camera[r, c] * points[m, c]
        depth = max(p[2], 0.05)
        u, v = p[0] / depth, p[1] / depth
        residual[0] = (camera[3, 0] * u + camera[3, 2] - pixels[m, 0]) * per_pixel
        residual[1] = (camera[3, 1] * v + camera[3, 3] - pixels[m, 1]) * per_pixel
        for a in range(count):
            dx = camera[0, 0] * rows[0, a] + camera[0, 1] * rows[1, a] + camera[0, 2] * rows[2, a]
            dy = camera[1, 0] * rows[0, a] + camera[1, 1] * rows[1, a] + camera[1, 2] * rows[2, a]
            dz = camera[2, 0] * rows[0, a] + camera[2, 1] * rows[1, a] + camera[2, 2] * rows[2, a]
            image_rows[0, a] = camera[3, 0] * per_pixel * (dx - u * dz) / depth
            image_rows[1, a] = camera[3, 1] * per_pixel * (dy - v * dz) / depth
        robust = math.sqrt(1.0 + residual[0] ** 2 + residual[1] ** 2)
        energy += 2.0 * pixel_weights[m] * (robust - 1.0)  # pseudo-Huber
        _add(normal, right, columns, image_rows, count, residual, 2, pixel_weights[m] / robust)

        # relative to the hips, which the root moves too: only the lever arm from them is left
        for a in range(rotations):
            if columns[a] < 3:
                for r in range(3):
                    rows[r, a] = 0.0
        x, y, z = (
            points[m, 0] - hips_centre[0],
            points[m, 1] - hips_centre[1],
            points[m, 2] - hips_centre[2],
        )
        a = rotations - 3
        rows[0, a + 1], rows[0, a + 2] = z, -y
        rows[1, a], rows[1, a + 2] = -z, x
        rows[2, a], rows[2, a + 1] = y, -x
        residual_3d[0], residual_3d[1], residual_3d[2] = (
            x - world[m, 0],
            y - world[m, 1],
            z - world[m, 2],
        )
        squared = 0.0
        for r in range(3):
            residual_3d[r] *= per_metre
            squared += residual_3d[r] ** 2
            for a in range(rotations):
                rows[r, a] *= per_metre
        robust = math.sqrt(1.0 + squared)
        weight = 0.5 * weights[m] * depth_weights[m]
        energy += 2.0 * weight * (robust - 1.0)
        _add(normal, right, columns, rows, rotations, residual_3d, 3, weight / robust)
    return energy


@numba.njit(cache=True)
def prior_equations(
    global_rotations: Array,  # [24 3 3]
    parents: Array,  # [24] int64
    angles: Array,  # [24 3] local rotations as axis-angle, rad
    mean: Array,  # [24 3]
    axes: Array,  # [24 3 3] rows along which `stiffness` counts
    stiffness: Array,  # [24 3] 1 / deviation^2
    normal: Array,  # [75 75], added to
    right: Array,  # [75], added to
) -> float:
    """Half the squared distance of all joints but the root from the prior's mean, in deviations.

    d theta = J^-1(theta) W_parent^T d, with the inverse left Jacobian of SO(3) (Sola et al. 2018,
    eq. 146).
    """
    energy = 0.0
    columns, rows, residual = np.empty(3, np.int64), np.empty((3, 3)), np.empty(3)
    inverse, jacobian = np.empty((3, 3)), np.empty((3, 3))
    for k in range(1, JOINTS):
        x, y, z = angles[k, 0], angles[k, 1], angles[k, 2]
        square = x * x + y * y + z * z
        if square < 1e-6:
            coefficient = 1.0 / 12.0
        else:
            half = 0.5 * math.sqrt(square)
            coefficient = (1.0 - half / math.tan(half)) / square
        for r in range(3):
            for c in range(3):
                inverse[r, c] = coefficient * angles[k, r] * angles[k, c]
            inverse[r, r] += 1.0 - coefficient * square
        inverse[0, 1], inverse[1, 0] = inverse[0, 1] + 0.5 * z, inverse[1, 0] - 0.5 * z
        inverse[2, 0], inverse[0, 2] = inverse[2, 0] + 0.5 * y, inverse[0, 2] - 0.5 * y
        inverse[1, 2], inverse[2, 1] = inverse[1, 2] + 0.5 * x, inverse[2, 1] - 0.5 * x
        multiply(axes[k], inverse, jacobian)
        parent_rotation = global_rotations[parents[k]]
        for s in range(3):
            columns[s] = 3 * k + s
            root, residual[s] = math.sqrt(0.5 * stiffness[k, s]), 0.0
            for c in range(3):
                residual[s] += root * axes[k, s, c] * (angles[k, c] - mean[k, c])
                rows[s, c] = 0.0
                for i in range(3):
                    rows[s, c] += root * jacobian[s, i] * parent_rotation[c, i]
            energy += residual[s] ** 2
        _add(normal, right, columns, rows, 3, residual, 3, 1.0)
    return energy


@numba.njit(cache=True)
def pose_equations(
    local: Array,  # [24 3 3]
    pelvis: Array,  # [3]
    model: SolverModel,
    observation: FrameObservation,
    world: Array,  # [33 3]: the 3D landmarks, sized as the body
    global_rotations: Array,  # [24 3 3], written: global rotations
    normal: Array,  # [75 75], written
    right: Array,  # [75], written
) -> float:
    """Energy of a pose and its normal equations."""
    positions, angles = np.empty((JOINTS, 3)), matrices_to_axis_angles(local)
    forward_kinematics(local, pelvis, model.rest, model.parents, global_rotations, positions)
    normal[:], right[:] = 0.0, 0.0
    energy = landmark_equations(
        global_rotations,
        positions,
        model.rest,
        model.parents,
        model.landmarks,
        model.joints,
        observation.pixels,
        observation.pixel_weights,
        observation.weights,
        model.depth_weights,
        world,
        model.hips,
        model.camera,
        observation.per_pixel,
        model.per_metre,
        normal,
        right,
    )
    return energy + prior_equations(
        global_rotations,
        model.parents,
        angles,
        model.mean,
        model.axes,
        model.stiffness,
        normal,
        right,
    )
