"""Energy of one frame's pose and its normal equations, for the live solver. float64.

Letters: W_k, p_k turn and place of joint k in the world; m = p_j + W_j (r - J_j) a landmark that
moves with joint j. A turn d_k (rad, world axes) of joint k and all beyond it moves every landmark
beyond it by d_k x (m - p_k): that is the whole Jacobian. Unknowns x: d_0 .. d_23, then the shift of
the pelvis: 75 numbers.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from scene.arrays import Array

JOINTS = 24
UNKNOWNS = 3 * JOINTS + 3


@numba.njit(cache=True, nogil=True)
def place_joints(
    local: Array,  # [24 3 3] turns relative to the parent
    pelvis: Array,  # [3] place of joint 0, m
    rest: Array,  # [24 3]
    parents: Array,  # [24] int64
    turned: Array,  # [24 3 3], written: world turns
    placed: Array,  # [24 3], written: world places
) -> None:
    """Forward kinematics."""
    turned[0], placed[0] = local[0], pelvis
    for k in range(1, JOINTS):
        above = parents[k]
        for r in range(3):
            place = placed[above, r]
            for c in range(3):
                place += turned[above, r, c] * (rest[k, c] - rest[above, c])
                total = 0.0
                for i in range(3):
                    total += turned[above, r, i] * local[k, i, c]
                turned[k, r, c] = total
            placed[k, r] = place


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
def _turn_rows(rows, columns, count, point, placed):
    """d point / d x of the turns in `columns`: the columns of -[point - p_k]x."""
    for a in range(0, count, 3):
        k = columns[a] // 3
        x, y, z = point[0] - placed[k, 0], point[1] - placed[k, 1], point[2] - placed[k, 2]
        rows[0, a], rows[0, a + 1], rows[0, a + 2] = 0.0, z, -y
        rows[1, a], rows[1, a + 1], rows[1, a + 2] = -z, 0.0, x
        rows[2, a], rows[2, a + 1], rows[2, a + 2] = y, -x, 0.0


@numba.njit(cache=True, nogil=True)
def landmark_equations(
    turned: Array,  # [24 3 3]
    placed: Array,  # [24 3]
    rest: Array,  # [24 3]
    parents: Array,  # [24] int64
    marks: Array,  # [33 3] rest points
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
    count_marks = len(marks)
    points = np.empty((count_marks, 3))
    for m in range(count_marks):
        j = joints[m]
        for r in range(3):
            points[m, r] = placed[j, r]
            for c in range(3):
                points[m, r] += turned[j, r, c] * (marks[m, c] - rest[j, c])
    middle = 0.5 * (points[hips[0]] + points[hips[1]])
    columns = np.empty(UNKNOWNS, np.int64)
    rows, flat = np.zeros((3, UNKNOWNS)), np.zeros((2, UNKNOWNS))
    off, gap, p = np.empty(2), np.empty(3), np.empty(3)
    energy = 0.0
    for m in range(count_marks):
        if trust[m] <= 0.0:
            continue
        turns = _unknowns_of(joints[m], parents, columns)
        _turn_rows(rows, columns, turns, points[m], placed)
        count = turns
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
        for a in range(turns):
            if columns[a] < 3:
                for r in range(3):
                    rows[r, a] = 0.0
        x, y, z = points[m, 0] - middle[0], points[m, 1] - middle[1], points[m, 2] - middle[2]
        a = turns - 3
        rows[0, a + 1], rows[0, a + 2] = z, -y
        rows[1, a], rows[1, a + 2] = -z, x
        rows[2, a], rows[2, a + 1] = y, -x
        gap[0], gap[1], gap[2] = x - seen[m, 0], y - seen[m, 1], z - seen[m, 2]
        squared = 0.0
        for r in range(3):
            gap[r] *= per_metre
            squared += gap[r] ** 2
            for a in range(turns):
                rows[r, a] *= per_metre
        far = math.sqrt(1.0 + squared)
        weight = 0.5 * trust[m] * depth_trust[m]
        energy += 2.0 * weight * (far - 1.0)
        _add(normal, right, columns, rows, turns, gap, 3, weight / far)
    return energy


@numba.njit(cache=True, nogil=True)
def prior_equations(
    turned: Array,  # [24 3 3]
    parents: Array,  # [24] int64
    angles: Array,  # [24 3] local turns as axis-angle, rad
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
    for k in range(1, JOINTS):
        x, y, z = angles[k]
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        angle = math.sqrt(x * x + y * y + z * z)
        if angle < 1e-3:
            second = 1.0 / 12.0
        else:
            half = 0.5 * angle
            second = (1.0 - half / math.tan(half)) / angle**2
        inverse = np.eye(3) - 0.5 * cross + second * (cross @ cross)
        turn = axes[k] @ inverse @ np.ascontiguousarray(turned[parents[k]].T)
        away = axes[k] @ (angles[k] - mean[k])
        for s in range(3):
            columns[s] = 3 * k + s
            root = math.sqrt(0.5 * stiffness[k, s])
            off[s] = root * away[s]
            for a in range(3):
                rows[s, a] = root * turn[s, a]
            energy += off[s] ** 2
        _add(normal, right, columns, rows, 3, off, 3, 1.0)
    return energy


@numba.njit(cache=True, nogil=True)
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
