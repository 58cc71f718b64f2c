"""Compiled kinematics of a clip, each function with its gradient: what `kinematics` is made of.

A gradient is that of a scalar loss: `by_x` is the loss's derivative with respect to x, and what is
added to must begin at zero. F frames, 24 joints, V points of at most K joints each. Sums of a frame
are made in its own order, so that the same input gives the same result.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from scene.arrays import Array
from scene.kinematics_kernels import multiply, multiply_transposed, write_rotation

_SMALL = 1e-4
"""rad^2, of the squared angle below which derivatives are taken from their series."""
NEAREST_M = 0.05
"""Depth at which points at the camera are kept finite."""


@numba.njit(cache=True, nogil=True)
def rotate(angles: Array, rotations: Array) -> None:
    """Rotations [N 3 3] by axis-angle [N 3], rad (Rodrigues)."""
    for n in range(len(angles)):
        write_rotation(angles[n, 0], angles[n, 1], angles[n, 2], rotations[n])


@numba.njit(cache=True, nogil=True)
def rotate_back(angles: Array, by_rotation: Array, by_angle: Array) -> None:
    """The gradient of `rotate`: R = cos(t) 1 + s [w]x + v w w^T, with s = sin(t) / t, v = (1 -
    cos(t)) / t^2, and t the length of w."""
    for n in range(len(angles)):
        x, y, z = float(angles[n, 0]), float(angles[n, 1]), float(angles[n, 2])
        g = by_rotation[n]
        square = x * x + y * y + z * z
        if square < _SMALL:
            s, v = 1.0 - square / 6.0, 0.5 - square / 24.0
            by_s, by_v = square / 30.0 - 1.0 / 3.0, square / 180.0 - 1.0 / 12.0
        else:
            t = math.sqrt(square)
            s, v = math.sin(t) / t, (1.0 - math.cos(t)) / square
            by_s, by_v = (math.cos(t) - s) / square, (s - 2.0 * v) / square
        ax, ay, az = g[2, 1] - g[1, 2], g[0, 2] - g[2, 0], g[1, 0] - g[0, 1]
        sx = 2.0 * g[0, 0] * x + (g[0, 1] + g[1, 0]) * y + (g[0, 2] + g[2, 0]) * z
        sy = (g[0, 1] + g[1, 0]) * x + 2.0 * g[1, 1] * y + (g[1, 2] + g[2, 1]) * z
        sz = (g[0, 2] + g[2, 0]) * x + (g[1, 2] + g[2, 1]) * y + 2.0 * g[2, 2] * z
        along = by_s * (ax * x + ay * y + az * z)
        along += 0.5 * by_v * (sx * x + sy * y + sz * z)
        along -= s * (g[0, 0] + g[1, 1] + g[2, 2])
        by_angle[n, 0] = s * ax + v * sx + along * x
        by_angle[n, 1] = s * ay + v * sy + along * y
        by_angle[n, 2] = s * az + v * sz + along * z


@numba.njit(cache=True, nogil=True)
def chain(
    local: Array, root: Array, rest: Array, parents: Array, rotations: Array, positions: Array
) -> None:
    """Rotations [F J 3 3] and positions [F J 3] of all joints, from local rotations; `root` [F 3]
    is the position of joint 0 itself, and each joint comes after its parent."""
    for f in range(len(local)):
        rotations[f, 0] = local[f, 0]
        positions[f, 0] = root[f]
        for j in range(1, len(rest)):
            p = parents[j]
            above = rotations[f, p]
            multiply(above, local[f, j], rotations[f, j])
            for r in range(3):
                at = positions[f, p, r]
                for c in range(3):
                    at += above[r, c] * (rest[j, c] - rest[p, c])
                positions[f, j, r] = at


@numba.njit(cache=True, nogil=True)
def chain_back(
    local: Array,
    rest: Array,
    parents: Array,
    rotations: Array,
    by_rotation: Array,
    by_position: Array,
    by_local: Array,
    by_root: Array,
    by_rest: Array,
) -> None:
    """The gradient of `chain`; spoils `by_rotation` and `by_position`, adds to `by_rest`."""
    for f in range(len(local)):
        for j in range(len(rest) - 1, 0, -1):
            p = parents[j]
            above, g, at = rotations[f, p], by_rotation[f, j], by_position[f, j]
            multiply_transposed(above, g, by_local[f, j])
            for r in range(3):
                for c in range(3):
                    to_parent = at[r] * (rest[j, c] - rest[p, c])
                    for k in range(3):
                        to_parent += g[r, k] * local[f, j, c, k]
                    by_rotation[f, p, r, c] += to_parent
            for c in range(3):
                bone = above[0, c] * at[0] + above[1, c] * at[1] + above[2, c] * at[2]
                by_rest[j, c] += bone
                by_rest[p, c] -= bone
                by_position[f, p, c] += at[c]
        by_local[f, 0] = by_rotation[f, 0]
        by_root[f] = by_position[f, 0]


@numba.njit(cache=True, nogil=True)
def skin(
    rotations: Array,
    positions: Array,
    rest: Array,
    points: Array,
    joints: Array,
    weights: Array,
    which: Array,
    posed: Array,
) -> None:
    """Points [F P 3] by linear blend skinning: of `points` [V 3] at rest, each moved by its
    `joints` [V K] with `weights` [V K], those that each frame asks for (`which` [F P])."""
    moves = np.empty((len(rest), 3), rotations.dtype)
    for f in range(len(which)):
        _moves(rotations[f], positions[f], rest, moves)
        for p in range(which.shape[1]):
            v = which[f, p]
            x, y, z = points[v, 0], points[v, 1], points[v, 2]
            at = posed[f, p]
            at[:] = 0.0
            for k in range(joints.shape[1]):
                w, j = weights[v, k], joints[v, k]
                if w == 0.0:
                    break
                turn = rotations[f, j]
                for r in range(3):
                    moved = turn[r, 0] * x + turn[r, 1] * y + turn[r, 2] * z + moves[j, r]
                    at[r] += w * moved


@numba.njit(cache=True, nogil=True)
def skin_back(
    rotations: Array,
    rest: Array,
    points: Array,
    joints: Array,
    weights: Array,
    which: Array,
    by_posed: Array,
    by_rotation: Array,
    by_position: Array,
    by_rest: Array,
    by_point: Array,
) -> None:
    """The gradient of `skin`; adds to all four."""
    for f in range(len(which)):
        for p in range(which.shape[1]):
            v, g = which[f, p], by_posed[f, p]
            x, y, z = points[v, 0], points[v, 1], points[v, 2]
            for k in range(joints.shape[1]):
                w, j = weights[v, k], joints[v, k]
                if w == 0.0:
                    break
                turn, by_turn = rotations[f, j], by_rotation[f, j]
                for r in range(3):
                    pull = w * g[r]
                    by_position[f, j, r] += pull
                    by_turn[r, 0] += pull * x
                    by_turn[r, 1] += pull * y
                    by_turn[r, 2] += pull * z
                    for c in range(3):
                        by_point[v, c] += turn[r, c] * pull
        for j in range(len(rest)):
            turn, by_turn, pull = rotations[f, j], by_rotation[f, j], by_position[f, j]
            for r in range(3):
                for c in range(3):
                    by_turn[r, c] -= pull[r] * rest[j, c]
                    by_rest[j, c] -= turn[r, c] * pull[r]


@numba.njit(cache=True)
def _moves(rotations: Array, positions: Array, rest: Array, moves: Array) -> None:
    """What is left of each joint's place once its rotation is about the origin."""
    for j in range(len(rest)):
        for r in range(3):
            moved = positions[j, r]
            for c in range(3):
                moved -= rotations[j, r, c] * rest[j, c]
            moves[j, r] = moved


@numba.njit(cache=True, nogil=True)
def pinhole(points: Array, focal: float, x: float, y: float, pixels: Array) -> None:
    """Pixels [N 2] of `points` [N 3] before a camera at the origin that looks along -z."""
    for n in range(len(points)):
        depth = max(-points[n, 2], NEAREST_M)
        pixels[n, 0] = x + focal * points[n, 0] / depth
        pixels[n, 1] = y - focal * points[n, 1] / depth


@numba.njit(cache=True, nogil=True)
def pinhole_back(points: Array, focal: float, by_pixel: Array, by_point: Array) -> float:
    """The gradient of `pinhole`; returns that of the focal length."""
    by_focal = 0.0
    for n in range(len(points)):
        depth = max(-points[n, 2], NEAREST_M)
        right, down = by_pixel[n, 0] / depth, -by_pixel[n, 1] / depth
        along = right * points[n, 0] + down * points[n, 1]
        by_focal += along
        by_point[n, 0] = focal * right
        by_point[n, 1] = focal * down
        by_point[n, 2] = focal * along / depth if -points[n, 2] > NEAREST_M else 0.0
    return by_focal
