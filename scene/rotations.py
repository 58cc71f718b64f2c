"""Rotations in numpy: axis-angle on disk, matrices in compute, quaternions (wxyz) on the wire.

Letters: `aa` axis-angle [..., 3] rad, `R` matrix [..., 3, 3], `wxyz` unit quaternion with w >= 0.
Formulas: Rodrigues (1840); Shepperd, "Quaternion from rotation matrix" (1978).
"""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float

_SMALL_ANGLE = 1e-4
"""rad; below it sin(a)/a and (1-cos a)/a^2 come from their series, exact in double precision."""


def axis_angle_to_matrix(axis_angle: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """Rotation matrices of axis-angle vectors (rad), by Rodrigues' formula."""
    angle = np.linalg.norm(axis_angle, axis=-1)[..., None, None]
    small = angle < _SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    versine = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    cross = _cross_matrix(axis_angle)
    result = np.eye(3) + sine * cross + versine * (cross @ cross)
    return result.astype(axis_angle.dtype, copy=False)


def axis_angle_to_quaternion(axis_angle: Float[Array, "*batch 3"]) -> Float[Array, "*batch 4"]:
    """Unit quaternions wxyz (w >= 0) of axis-angle vectors (rad)."""
    half = 0.5 * np.linalg.norm(axis_angle, axis=-1, keepdims=True)
    # sin(a/2) / a, also where a is nil: numpy's sinc is of pi times its argument
    vector = 0.5 * np.sinc(half / np.pi) * axis_angle
    wxyz = np.concatenate([np.cos(half), vector], axis=-1)
    return np.where(wxyz[..., :1] < 0.0, -wxyz, wxyz).astype(axis_angle.dtype, copy=False)


def matrix_to_axis_angle(matrix: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 3"]:
    """Axis-angle vectors (rad, in [0, pi]) of rotation matrices; stable near 0 and near pi."""
    wxyz = matrix_to_quaternion(matrix).astype(np.float64)
    vector = wxyz[..., 1:]
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, wxyz[..., :1])
    small = sine < _SMALL_ANGLE
    # angle / sin(angle/2) -> 2 + angle^2/12 as the angle goes to zero
    scale = np.where(small, 2.0 + angle**2 / 12.0, angle / np.where(small, 1.0, sine))
    return (vector * scale).astype(matrix.dtype, copy=False)


def matrix_to_quaternion(matrix: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 4"]:
    """Unit quaternions wxyz (w >= 0) of rotation matrices, by Shepperd's largest-component rule."""
    m = matrix.astype(np.float64)
    diagonal = np.stack([m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    trace = diagonal.sum(axis=-1, keepdims=True)
    squares = np.concatenate([trace, 2.0 * diagonal - trace], axis=-1)  # 4 c^2 - 1 per component
    x, y, z = (
        m[..., 2, 1] - m[..., 1, 2],
        m[..., 0, 2] - m[..., 2, 0],
        m[..., 1, 0] - m[..., 0, 1],
    )
    xy, xz, yz = (
        m[..., 0, 1] + m[..., 1, 0],
        m[..., 0, 2] + m[..., 2, 0],
        m[..., 1, 2] + m[..., 2, 1],
    )
    products = np.stack(
        [
            np.stack([1.0 + squares[..., 0], x, y, z], axis=-1),
            np.stack([x, 1.0 + squares[..., 1], xy, xz], axis=-1),
            np.stack([y, xy, 1.0 + squares[..., 2], yz], axis=-1),
            np.stack([z, xz, yz, 1.0 + squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )  # row i: 4 c_i * (w, x, y, z)
    largest = np.argmax(squares, axis=-1)
    wxyz = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    wxyz = wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True)
    return np.where(wxyz[..., :1] < 0.0, -wxyz, wxyz).astype(matrix.dtype, copy=False)


def quaternion_to_matrix(wxyz: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3 3"]:
    """Rotation matrices of quaternions wxyz of any length but zero."""
    q = wxyz.astype(np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    w, v = q[..., :1, None], q[..., 1:]
    cross = _cross_matrix(v)
    return (np.eye(3) + 2.0 * w * cross + 2.0 * (cross @ cross)).astype(wxyz.dtype, copy=False)


def slerp(
    start: Float[Array, "*batch 3 3"], end: Float[Array, "*batch 3 3"], fraction: float
) -> Float[Array, "*batch 3 3"]:
    """The rotation `fraction` of the way from `start` to `end` along the shortest arc."""
    step = matrix_to_axis_angle(np.swapaxes(start, -1, -2) @ end)
    return start @ axis_angle_to_matrix(np.asarray(fraction, dtype=step.dtype) * step)


def rotation_between(
    start: Float[Array, "*batch 3"], end: Float[Array, "*batch 3"]
) -> Float[Array, "*batch 3 3"]:
    """The smallest rotation that turns the direction `start` into the direction `end`.

    For opposite directions every half turn about a perpendicular axis is smallest; one is chosen.
    """
    a = start / np.linalg.norm(start, axis=-1, keepdims=True)
    b = end / np.linalg.norm(end, axis=-1, keepdims=True)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    weakest = np.eye(3, dtype=a.dtype)[np.argmin(np.abs(a), axis=-1)]
    perpendicular = np.cross(a, weakest)
    perpendicular /= np.linalg.norm(perpendicular, axis=-1, keepdims=True)
    unit = np.where(sine > 1e-12, axis / np.where(sine > 1e-12, sine, 1.0), perpendicular)
    return axis_angle_to_matrix(unit * np.arctan2(sine, cosine))


def _cross_matrix(vector: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
