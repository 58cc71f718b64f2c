"""Splats moved at rest by the cloth that they lie on, and gradients taken back.

Letters: N splats, P parameters, M of them on cloth, V vertices.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.layout import POSITION, ROTATION
from scene.arrays import Array


@numba.njit(nogil=True, cache=True, fastmath=True)
def surface_frames(
    vertices: Array,  # [V 3] float64, m
    corners: Array,  # [M 4] int32: upper left, upper right, lower left, lower right of the quad
    mix: Array,  # [M 2] float32: how far to the right and down
    places: Array,  # [M 3] float64: points on the cloth
    frames: Array,  # [M 3 3] float64: columns across, down the thread and along the normal
) -> None:
    """Where each splat's point of the cloth is, and how the cloth lies there."""
    right, down = np.empty(3), np.empty(3)
    for m in range(corners.shape[0]):
        a, b, c, d = corners[m, 0], corners[m, 1], corners[m, 2], corners[m, 3]
        u, v = mix[m, 0], mix[m, 1]
        for x in range(3):
            upper = vertices[b, x] - vertices[a, x]
            lower = vertices[d, x] - vertices[c, x]
            right[x] = (1.0 - v) * upper + v * lower
            left_down = vertices[c, x] - vertices[a, x]
            right_down = vertices[d, x] - vertices[b, x]
            down[x] = (1.0 - u) * left_down + u * right_down
            places[m, x] = vertices[a, x] + u * upper + v * ((1.0 - u) * left_down + u * right_down)
        length = math.sqrt(down[0] ** 2 + down[1] ** 2 + down[2] ** 2) + 1e-12
        for x in range(3):
            down[x] /= length
        nx = right[1] * down[2] - right[2] * down[1]
        ny = right[2] * down[0] - right[0] * down[2]
        nz = right[0] * down[1] - right[1] * down[0]
        length = math.sqrt(nx * nx + ny * ny + nz * nz) + 1e-12
        nx, ny, nz = nx / length, ny / length, nz / length
        frames[m, 0, 0] = down[1] * nz - down[2] * ny
        frames[m, 1, 0] = down[2] * nx - down[0] * nz
        frames[m, 2, 0] = down[0] * ny - down[1] * nx
        for x in range(3):
            frames[m, x, 1] = down[x]
        frames[m, 0, 2], frames[m, 1, 2], frames[m, 2, 2] = nx, ny, nz


@numba.njit(nogil=True, cache=True, fastmath=True)
def _turn(frames: Array, rest_frames: Array, m: int, turn: Array) -> None:
    """How the cloth has turned at splat `m` since rest."""
    for x in range(3):
        for y in range(3):
            turn[x, y] = (
                frames[m, x, 0] * rest_frames[m, y, 0]
                + frames[m, x, 1] * rest_frames[m, y, 1]
                + frames[m, x, 2] * rest_frames[m, y, 2]
            )


@numba.njit(nogil=True, cache=True, fastmath=True)
def _quaternion(r: Array, q: Array) -> None:
    """wxyz of a rotation matrix, by its largest component (Shepperd 1978)."""
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    if trace > 0.0:
        s = 2.0 * math.sqrt(trace + 1.0)
        q[0], q[1] = 0.25 * s, (r[2, 1] - r[1, 2]) / s
        q[2], q[3] = (r[0, 2] - r[2, 0]) / s, (r[1, 0] - r[0, 1]) / s
        return
    i = 0
    if r[1, 1] > r[0, 0]:
        i = 1
    if r[2, 2] > r[i, i]:
        i = 2
    j, k = (i + 1) % 3, (i + 2) % 3
    s = 2.0 * math.sqrt(max(1.0 + r[i, i] - r[j, j] - r[k, k], 1e-12))
    q[0], q[1 + i] = (r[k, j] - r[j, k]) / s, 0.25 * s
    q[1 + j], q[1 + k] = (r[j, i] + r[i, j]) / s, (r[k, i] + r[i, k]) / s


@numba.njit(nogil=True, cache=True, fastmath=True)
def hang(
    parameters: Array,  # [N P] float32; positions and rotations of the M replaced
    rows: Array,  # [M] int32
    own: Array,  # [M P] float32: the same splats where the cloth is at rest
    rest_places: Array,  # [M 3] float64
    rest_frames: Array,  # [M 3 3] float64
    places: Array,  # [M 3] float64
    frames: Array,  # [M 3 3] float64
) -> None:
    """Put splats where the cloth has gone, turned as it is."""
    turn, q = np.empty((3, 3)), np.empty(4)
    for m in range(rows.shape[0]):
        _turn(frames, rest_frames, m, turn)
        _quaternion(turn, q)
        n = rows[m]
        for x in range(3):
            moved = places[m, x]
            for y in range(3):
                moved += turn[x, y] * (own[m, POSITION + y] - rest_places[m, y])
            parameters[n, POSITION + x] = moved
        w, i = own[m, ROTATION], own[m, ROTATION + 1]
        j, k = own[m, ROTATION + 2], own[m, ROTATION + 3]
        parameters[n, ROTATION] = q[0] * w - q[1] * i - q[2] * j - q[3] * k
        parameters[n, ROTATION + 1] = q[0] * i + q[1] * w + q[2] * k - q[3] * j
        parameters[n, ROTATION + 2] = q[0] * j - q[1] * k + q[2] * w + q[3] * i
        parameters[n, ROTATION + 3] = q[0] * k + q[1] * j - q[2] * i + q[3] * w


@numba.njit(nogil=True, cache=True, fastmath=True)
def take_back(
    gradient: Array,  # [N P] float32, by parameters that `hang` has moved; replaced
    rows: Array,
    rest_frames: Array,
    frames: Array,
) -> None:
    """Gradients by the parameters where the cloth is at rest."""
    turn, q, back = np.empty((3, 3)), np.empty(4), np.empty(4)
    for m in range(rows.shape[0]):
        _turn(frames, rest_frames, m, turn)
        _quaternion(turn, q)
        n = rows[m]
        for x in range(3):
            back[x] = 0.0
            for y in range(3):
                back[x] += turn[y, x] * gradient[n, POSITION + y]
        for x in range(3):
            gradient[n, POSITION + x] = back[x]
        w, i = gradient[n, ROTATION], gradient[n, ROTATION + 1]
        j, k = gradient[n, ROTATION + 2], gradient[n, ROTATION + 3]
        gradient[n, ROTATION] = q[0] * w + q[1] * i + q[2] * j + q[3] * k
        gradient[n, ROTATION + 1] = q[0] * i - q[1] * w - q[2] * k + q[3] * j
        gradient[n, ROTATION + 2] = q[0] * j + q[1] * k - q[2] * w - q[3] * i
        gradient[n, ROTATION + 3] = q[0] * k - q[1] * j + q[2] * i - q[3] * w
