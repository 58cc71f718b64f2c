"""The live solver's steps on one frame: energy, normal equations, the way down; and its filter.

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
    axis_angles_to_matrices,
    forward_kinematics,
    matrices_to_axis_angles,
    multiply,
    multiply_transposed,
    relative_axis_angles,
    write_rotation,
)

JOINTS = 24
UNKNOWNS = 3 * JOINTS + 3
"""A rotation of each joint and the pelvis' translation."""


class SolverModel(NamedTuple):
    """What stays from frame to frame: a body, its camera, a prior, how much is believed."""

    rest: Array  # [24 3]
    parents: Array  # [24] int64
    landmarks: Array  # [33 3] rest points of the landmarks
    joints: Array  # [33] int64: the joint of each
    hips: Array  # [2] int64: landmarks whose middle is the origin of the 3D ones
    depth_trust: Array  # [33]
    camera: Array  # [4 4]: rows of R|t, then fx, fy, cx, cy
    per_metre: float  # 1 / deviation of a 3D landmark
    mean: Array  # [24 3]
    axes: Array  # [24 3 3] rows along which `stiffness` counts
    stiffness: Array  # [24 3] 1 / deviation^2


class FrameObservation(NamedTuple):
    """One frame's landmarks."""

    pixels: Array  # [33 2]
    trust: Array  # [33]
    world: Array  # [33 3] m, from between the hips, world axes
    per_pixel: float  # 1 / deviation of a landmark on the picture


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
    trust: Array,  # [33]
    depth_trust: Array,  # [33], beside `trust`
    seen: Array,  # [33 3] the estimator's 3D landmarks from between the hips, m, world axes
    hips: Array,  # [2] int64: landmarks whose middle is the origin of `seen`
    camera: Array,  # [4 4]: rows of R|t, then fx, fy, cx, cy
    per_pixel: float,  # 1 / deviation of a landmark on the picture
    per_metre: float,  # 1 / deviation of a 3D landmark
    normal: Array,  # [75 75], added to
    right: Array,  # [75], added to
) -> float:
    """Robust energy of the landmarks, on the picture and in 3D; its normal equations."""
    count_marks = len(landmarks)
    points = landmark_positions(global_rotations, positions, rest, landmarks, joints)
    middle = 0.5 * (points[hips[0]] + points[hips[1]])
    columns = np.empty(UNKNOWNS, np.int64)
    rows, flat = np.zeros((3, UNKNOWNS)), np.zeros((2, UNKNOWNS))
    off, gap, p = np.empty(2), np.empty(3), np.empty(3)
    energy = 0.0
    for m in range(count_marks):
        if trust[m] <= 0.0:
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
        off[0] = (camera[3, 0] * u + camera[3, 2] - pixels[m, 0]) * per_pixel
        off[1] = (camera[3, 1] * v + camera[3, 3] - pixels[m, 1]) * per_pixel
        for a in range(count):
            dx = camera[0, 0] * rows[0, a] + camera[0, 1] * rows[1, a] + camera[0, 2] * rows[2, a]
            dy = camera[1, 0] * rows[0, a] + camera[1, 1] * rows[1, a] + camera[1, 2] * rows[2, a]
            dz = camera[2, 0] * rows[0, a] + camera[2, 1] * rows[1, a] + camera[2, 2] * rows[2, a]
            flat[0, a] = camera[3, 0] * per_pixel * (dx - u * dz) / depth
            flat[1, a] = camera[3, 1] * per_pixel * (dy - v * dz) / depth
        far = math.sqrt(1.0 + off[0] ** 2 + off[1] ** 2)
        energy += 2.0 * trust[m] * (far - 1.0)  # pseudo-Huber
        _add(normal, right, columns, flat, count, off, 2, trust[m] / far)

        # from between the hips, which the pelvis moves: only the lever to there is left of it
        for a in range(rotations):
            if columns[a] < 3:
                for r in range(3):
                    rows[r, a] = 0.0
        x, y, z = points[m, 0] - middle[0], points[m, 1] - middle[1], points[m, 2] - middle[2]
        a = rotations - 3
        rows[0, a + 1], rows[0, a + 2] = z, -y
        rows[1, a], rows[1, a + 2] = -z, x
        rows[2, a], rows[2, a + 1] = y, -x
        gap[0], gap[1], gap[2] = x - seen[m, 0], y - seen[m, 1], z - seen[m, 2]
        squared = 0.0
        for r in range(3):
            gap[r] *= per_metre
            squared += gap[r] ** 2
            for a in range(rotations):
                rows[r, a] *= per_metre
        far = math.sqrt(1.0 + squared)
        weight = 0.5 * trust[m] * depth_trust[m]
        energy += 2.0 * weight * (far - 1.0)
        _add(normal, right, columns, rows, rotations, gap, 3, weight / far)
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
    columns, rows, off = np.empty(3, np.int64), np.empty((3, 3)), np.empty(3)
    inverse, along = np.empty((3, 3)), np.empty((3, 3))
    for k in range(1, JOINTS):
        x, y, z = angles[k, 0], angles[k, 1], angles[k, 2]
        square = x * x + y * y + z * z
        if square < 1e-6:
            second = 1.0 / 12.0
        else:
            half = 0.5 * math.sqrt(square)
            second = (1.0 - half / math.tan(half)) / square
        for r in range(3):
            for c in range(3):
                inverse[r, c] = second * angles[k, r] * angles[k, c]
            inverse[r, r] += 1.0 - second * square
        inverse[0, 1], inverse[1, 0] = inverse[0, 1] + 0.5 * z, inverse[1, 0] - 0.5 * z
        inverse[2, 0], inverse[0, 2] = inverse[2, 0] + 0.5 * y, inverse[0, 2] - 0.5 * y
        inverse[1, 2], inverse[2, 1] = inverse[1, 2] + 0.5 * x, inverse[2, 1] - 0.5 * x
        multiply(axes[k], inverse, along)
        above = global_rotations[parents[k]]
        for s in range(3):
            columns[s] = 3 * k + s
            root, off[s] = math.sqrt(0.5 * stiffness[k, s]), 0.0
            for c in range(3):
                off[s] += root * axes[k, s, c] * (angles[k, c] - mean[k, c])
                rows[s, c] = 0.0
                for i in range(3):
                    rows[s, c] += root * along[s, i] * above[c, i]
            energy += off[s] ** 2
        _add(normal, right, columns, rows, 3, off, 3, 1.0)
    return energy


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
def pose_equations(
    local: Array,  # [24 3 3]
    pelvis: Array,  # [3]
    model: SolverModel,
    seen: FrameObservation,
    world: Array,  # [33 3]: the 3D landmarks, sized as the body
    global_rotations: Array,  # [24 3 3], written: global rotations
    normal: Array,  # [75 75], written
    right: Array,  # [75], written
) -> float:
    """Energy of a pose and its normal equations."""
    positions, angles = np.empty((JOINTS, 3)), matrices_to_axis_angles(local)
    forward_kinematics(local, pelvis, model.rest, model.parents, global_rotations, positions)
    normal[:], right[:] = 0.0, 0.0
    return landmark_equations(
        global_rotations, positions, model.rest, model.parents, model.landmarks, model.joints,
        seen.pixels, seen.trust, model.depth_trust, world, model.hips, model.camera, seen.per_pixel,
        model.per_metre, normal, right,
    ) + prior_equations(
        global_rotations, model.parents, angles, model.mean, model.axes, model.stiffness,
        normal, right,
    )  # fmt: skip


@numba.njit(cache=True)
def moved_pose(local: Array, global_rotations: Array, parents: Array, step: Array) -> Array:
    """Local rotations [24 3 3] after those of `step` [75] about world axes: W^T exp(d) W L."""
    out, once, twice = np.empty(local.shape), np.empty((3, 3)), np.empty((3, 3))
    for k in range(JOINTS):
        write_rotation(step[3 * k], step[3 * k + 1], step[3 * k + 2], once)
        if k == 0:
            multiply(once, local[0], out[0])
            continue
        above = global_rotations[parents[k]]
        multiply(once, above, twice)
        multiply_transposed(above, twice, once)
        multiply(once, local[k], out[k])
    return out


@numba.njit(cache=True, nogil=True)
def refined(
    local: Array,  # [24 3 3]
    pelvis: Array,  # [3]
    model: SolverModel,
    seen: FrameObservation,
    steps: int,
    pull: Array,  # [75]: 1 / deviation^2 that holds each unknown at the start
    damping: float,  # share of the diagonal that is added
    floor: float,
) -> tuple[Array, Array, float]:
    """Local rotations, the pelvis' position and the energy after damped Gauss-Newton steps.

    The 3D landmarks count as large as the body at the start.
    """
    global_rotations, normal, right = np.empty((JOINTS, 3, 3)), np.empty((75, 75)), np.empty(75)
    new_rotations, new_normal, new_right = global_rotations.copy(), normal.copy(), right.copy()
    world = seen.world * _size(local, model, seen)
    energy = pose_equations(local, pelvis, model, seen, world, global_rotations, normal, right)
    gone, step, cost = np.zeros(UNKNOWNS), np.empty(UNKNOWNS), energy
    for _ in range(steps):
        held, pulled = right.copy(), normal.copy()
        for i in range(UNKNOWNS):
            held[i] -= 0.5 * pull[i] * gone[i]
            pulled[i, i] += 0.5 * pull[i]
        damped_step(pulled, held, damping, floor, step)
        new_local = moved_pose(local, global_rotations, model.parents, step)
        new_pelvis = pelvis + step[3 * JOINTS :]
        new_energy = pose_equations(
            new_local, new_pelvis, model, seen, world, new_rotations, new_normal, new_right
        )
        further, total = gone + step, new_energy
        for i in range(UNKNOWNS):
            total += 0.5 * pull[i] * further[i] * further[i]
        if total < cost:
            local, pelvis, energy, gone, cost = new_local, new_pelvis, new_energy, further, total
            global_rotations, new_rotations = new_rotations, global_rotations
            normal, new_normal = new_normal, normal
            right, new_right = new_right, right
            damping *= 0.1
        else:
            damping *= 10.0
    # a product of many rotations drifts off: the next frame would start from it and drift on
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
def _size(local: Array, model: SolverModel, seen: FrameObservation) -> float:
    """How much larger the body is than the 3D landmarks, in about this pose."""
    points = body_landmarks(local, model)
    middle = 0.5 * (points[model.hips[0]] + points[model.hips[1]])
    ours, theirs = 0.0, 0.0
    for m in range(len(points)):
        for c in range(3):
            ours += seen.trust[m] * (points[m, c] - middle[c]) * seen.world[m, c]
            theirs += seen.trust[m] * seen.world[m, c] ** 2
    return ours / theirs


@numba.njit(cache=True)
def filter_rotations(
    rotations: Array,  # [24 3 3], written: where joints are shown
    angular_velocity: Array,  # [24 3], written: rad/s
    before: Array,  # [24 3 3]: where they were seen last
    seen: Array,  # [24 3 3]: where they are seen now
    step_s: float,
    speed_cutoff_hz: float,
    cutoff_hz: float,
    cutoff_per_rad_s: float,
) -> None:
    """One step of the One-Euro filter, each joint along its geodesic; see `capture.live.filter`."""
    found, apart = relative_axis_angles(before, seen), relative_axis_angles(rotations, seen)
    share, step, moved = _share(speed_cutoff_hz, step_s), np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(rotations)):
        pace = 0.0
        for c in range(3):
            angular_velocity[k, c] += share * (found[k, c] / step_s - angular_velocity[k, c])
            pace += angular_velocity[k, c] ** 2
        own = _share(cutoff_hz + cutoff_per_rad_s * math.sqrt(pace), step_s)
        write_rotation(own * apart[k, 0], own * apart[k, 1], own * apart[k, 2], step)
        multiply(rotations[k], step, moved)
        rotations[k] = moved


@numba.njit(inline="always")
def _share(cutoff_hz, step_s):
    """How far a low pass goes in one step."""
    return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff_hz * step_s))
