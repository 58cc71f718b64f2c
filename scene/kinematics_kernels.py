"""Compiled rotations and forward kinematics of one body, for live poses. float64.

`scene.rotations` and `scene.skeleton` say the same for any batch, and are the twins that these are
tested against; there each of many small steps costs more than the arithmetic. A rotation is a
matrix; angles are axis-angle, rad. All take microseconds, too little to let another thread run
meanwhile: it would be milliseconds until it is their turn again.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from scene.arrays import Array

_SMALL_ANGLE = 1e-4
"""rad; as in `scene.rotations`."""


@numba.njit(cache=True)
def write_rotation(x: float, y: float, z: float, rotation: Array) -> None:
    """The rotation [3 3] by the angles x, y, z, by Rodrigues' formula."""
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < _SMALL_ANGLE:
        sine, versine = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        sine, versine = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    rotation[0, 0] = 1.0 - versine * (y * y + z * z)
    rotation[1, 1] = 1.0 - versine * (x * x + z * z)
    rotation[2, 2] = 1.0 - versine * (x * x + y * y)
    rotation[0, 1], rotation[1, 0] = versine * x * y - sine * z, versine * x * y + sine * z
    rotation[0, 2], rotation[2, 0] = versine * x * z + sine * y, versine * x * z - sine * y
    rotation[1, 2], rotation[2, 1] = versine * y * z - sine * x, versine * y * z + sine * x


@numba.njit(cache=True)
def write_axis_angle(m: Array, angles: Array) -> None:
    """The angles [3] of the rotation `m`: Shepperd's quaternion, then its logarithm."""
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    x, y, z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    if trace >= max(m[0, 0], m[1, 1], m[2, 2]):
        w = 1.0 + trace
    elif m[0, 0] >= max(m[1, 1], m[2, 2]):
        w, x = x, 1.0 + 2.0 * m[0, 0] - trace
        y, z = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]
    elif m[1, 1] >= m[2, 2]:
        w, y = y, 1.0 + 2.0 * m[1, 1] - trace
        x, z = m[0, 1] + m[1, 0], m[1, 2] + m[2, 1]
    else:
        w, z = z, 1.0 + 2.0 * m[2, 2] - trace
        x, y = m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    length = math.sqrt(w * w + x * x + y * y + z * z)
    sign = -1.0 if w < 0.0 else 1.0
    w, x, y, z = sign * w / length, sign * x / length, sign * y / length, sign * z / length
    sine = math.sqrt(x * x + y * y + z * z)
    angle = 2.0 * math.atan2(sine, w)
    scale = 2.0 + angle * angle / 12.0 if sine < _SMALL_ANGLE else angle / sine
    angles[0], angles[1], angles[2] = x * scale, y * scale, z * scale


@numba.njit(cache=True)
def multiply(a: Array, b: Array, out: Array) -> None:
    """a b, of 3 x 3 matrices; `out` is neither of them."""
    for r in range(3):
        for c in range(3):
            out[r, c] = a[r, 0] * b[0, c] + a[r, 1] * b[1, c] + a[r, 2] * b[2, c]


@numba.njit(cache=True)
def multiply_transposed(a: Array, b: Array, out: Array) -> None:
    """a^T b, of 3 x 3 matrices; `out` is neither of them."""
    for r in range(3):
        for c in range(3):
            out[r, c] = a[0, r] * b[0, c] + a[1, r] * b[1, c] + a[2, r] * b[2, c]


@numba.njit(cache=True)
def axis_angles_to_matrices(angles: Array) -> Array:
    """The rotations [K 3 3] by `angles` [K 3]."""
    rotations = np.empty((len(angles), 3, 3))
    for k in range(len(angles)):
        write_rotation(angles[k, 0], angles[k, 1], angles[k, 2], rotations[k])
    return rotations


@numba.njit(cache=True)
def matrices_to_axis_angles(rotations: Array) -> Array:
    """The angles [K 3] of `rotations` [K 3 3]."""
    angles = np.empty((len(rotations), 3))
    for k in range(len(rotations)):
        write_axis_angle(rotations[k], angles[k])
    return angles


@numba.njit(cache=True)
def relative_axis_angles(start: Array, end: Array) -> Array:
    """The angles [K 3] from the rotations `start` to `end` [K 3 3], in the frames of `start`."""
    angles, step = np.empty((len(start), 3)), np.empty((3, 3))
    for k in range(len(start)):
        multiply_transposed(start[k], end[k], step)
        write_axis_angle(step, angles[k])
    return angles


@numba.njit(cache=True)
def integrate_rotations(rotations: Array, rotation_vectors: Array, factor: float) -> Array:
    """The angles [K 3] of R exp(factor * v) for `rotations` R [K 3 3] and `rotation_vectors` v [K
    3].

    The vectors are in each rotation's own frame: velocities in rad/s with a duration in s as the
    factor, or whole steps in rad with the share of them that is taken.
    """
    angles, step, moved = np.empty(rotation_vectors.shape), np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(rotations)):
        x, y, z = rotation_vectors[k, 0], rotation_vectors[k, 1], rotation_vectors[k, 2]
        write_rotation(factor * x, factor * y, factor * z, step)
        multiply(rotations[k], step, moved)
        write_axis_angle(moved, angles[k])
    return angles


@numba.njit(cache=True)
def slerp(start: Array, end: Array, share: float) -> Array:
    """The rotation [3 3] `share` of the way from `start` to `end` [3 3] along the shortest arc."""
    step, angles, out = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    multiply_transposed(start, end, step)
    write_axis_angle(step, angles)
    write_rotation(share * angles[0], share * angles[1], share * angles[2], step)
    multiply(start, step, out)
    return out


@numba.njit(cache=True)
def length(vector: Array) -> float:
    """Of a vector [3]."""
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])


@numba.njit(cache=True)
def write_cross(a: Array, b: Array, out: Array) -> None:
    """a x b, of vectors [3]; `np.cross` takes seconds to compile."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def rotation_between(start: Array, end: Array) -> Array:
    """The smallest rotation [3 3] of the direction `start` into the direction `end` [3].

    For opposite directions one about an axis across is chosen.
    """
    rotation, axis = np.empty((3, 3)), np.empty(3)
    cosine = start[0] * end[0] + start[1] * end[1] + start[2] * end[2]
    write_cross(start, end, axis)
    sine, lengths = length(axis), length(start) * length(end)
    angle = math.atan2(sine, cosine)
    if sine <= 1e-12 * lengths:
        weakest, least = np.zeros(3), min(abs(start[0]), abs(start[1]), abs(start[2]))
        for c in range(3):
            if abs(start[c]) == least:
                weakest[c] = 1.0
                break
        write_cross(start, weakest, axis)
        sine = length(axis)
    scale = angle / sine
    write_rotation(scale * axis[0], scale * axis[1], scale * axis[2], rotation)
    return rotation


@numba.njit(cache=True)
def forward_kinematics(
    local: Array,  # [K 3 3] rotations relative to the parent
    pelvis: Array,  # [3] place of joint 0, m
    rest: Array,  # [K 3]
    parents: Array,  # [K] int64
    global_rotations: Array,  # [K 3 3], written: joint -> world
    joint_positions: Array,  # [K 3], written: world, m
) -> None:
    """Forward kinematics."""
    global_rotations[0], joint_positions[0] = local[0], pelvis
    for k in range(1, len(local)):
        above = parents[k]
        multiply(global_rotations[above], local[k], global_rotations[k])
        for r in range(3):
            place = joint_positions[above, r]
            for c in range(3):
                place += global_rotations[above, r, c] * (rest[k, c] - rest[above, c])
            joint_positions[k, r] = place


@numba.njit(cache=True)
def skinning(
    angles: Array,  # [K 3]
    pelvis: Array,  # [3] place of joint 0, m
    rest: Array,  # [K 3]
    parents: Array,  # [K] int64
    placement: Array,  # [4 4] rigid: the body's world -> room
) -> Array:
    """Rest -> room of what is bound to each joint: [K 4 4]."""
    count = len(rest)
    local, out = axis_angles_to_matrices(angles), np.zeros((count, 4, 4))
    global_rotations, joint_positions = np.empty((count, 3, 3)), np.empty((count, 3))
    forward_kinematics(local, pelvis, rest, parents, global_rotations, joint_positions)
    for k in range(count):
        multiply(placement, global_rotations[k], out[k])
        for r in range(3):
            shift = placement[r, 3]
            for c in range(3):
                shift += placement[r, c] * joint_positions[k, c] - out[k, r, c] * rest[k, c]
            out[k, r, 3] = shift
        out[k, 3, 3] = 1.0
    return out
