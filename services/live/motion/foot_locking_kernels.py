"""Legs that reach where feet are held, compiled; for `services.live.motion.foot_locking`. float64.

A leg is two bones of fixed length: its knee lies where the circle round the way from hip to ankle
meets the side on which it was.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from scene.arrays import Array
from scene.kinematics_kernels import (
    forward_kinematics,
    length,
    multiply,
    multiply_transposed,
    rotation_between,
    write_rotation,
)

REACH = 0.999
"""A leg is never stretched further: a straight knee has no way to bend."""


@numba.njit(cache=True)
def level(turn: Array) -> Array:
    """The turn [3 3] about the vertical alone that faces the same way."""
    out = np.empty((3, 3))
    write_rotation(0.0, math.atan2(turn[0, 2], turn[2, 2]), 0.0, out)
    return out


@numba.njit(cache=True)
def bend(
    hip: Array, knee: Array, foot: Array, forwards: Array, ankle: Array
) -> tuple[Array, Array]:
    """The turns [3 3] of thigh and shin that bring the foot to `ankle`, as far as the leg reaches.

    `hip`, `knee` and `foot` are where they are now, m; `forwards` is where the thigh's front looks.
    """
    thigh, shin, reach, line = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for c in range(3):
        thigh[c], shin[c] = knee[c] - hip[c], foot[c] - knee[c]
        reach[c], line[c] = ankle[c] - hip[c], foot[c] - hip[c]
    upper, lower = length(thigh), length(shin)
    distance = min(max(length(reach), 1e-6), REACH * (upper + lower))
    share = (upper * upper - lower * lower + distance * distance) / (2.0 * distance)
    _scale(reach, 1.0 / max(length(reach), 1e-9))
    _scale(line, 1.0 / max(length(line), 1e-9))
    # a nearly straight knee hardly says where it bends to: forwards
    pole, along = np.empty(3), _dot(thigh, line)
    for c in range(3):
        pole[c] = thigh[c] - along * line[c] + 0.1 * upper * forwards[c]
    along = _dot(pole, reach)
    for c in range(3):
        pole[c] -= along * reach[c]
    _scale(pole, math.sqrt(max(upper * upper - share * share, 0.0)) / max(length(pole), 1e-9))
    new_thigh, new_shin = np.empty(3), np.empty(3)
    for c in range(3):
        new_thigh[c] = share * reach[c] + pole[c]
        new_shin[c] = distance * reach[c] - new_thigh[c]
    return rotation_between(thigh, new_thigh), rotation_between(shin, new_shin)


@numba.njit(cache=True)
def _dot(a: Array, b: Array) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def _distance(a: Array, b: Array) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@numba.njit(cache=True)
def _scale(vector: Array, by: float) -> None:
    for c in range(3):
        vector[c] *= by


@numba.njit(cache=True)
def reach_with(
    local: Array,  # [24 3 3] turns relative to the parent; changed: those of both legs
    pelvis: Array,  # [3] m
    rest: Array,  # [24 3]
    parents: Array,  # [24] int64
    legs: Array,  # [2 4] int64: hip, knee, ankle, foot
    ankles: Array,  # [2 3] where the ankles shall be, m
    turns: Array,  # [2 3 3] how the feet shall be turned, world
) -> float:
    """Bend both legs to their ankles. Returns how far the pelvis sinks where one falls short, m."""
    turned, placed = np.empty(local.shape), np.empty(rest.shape)
    forward_kinematics(local, pelvis, rest, parents, turned, placed)
    sink = 0.0
    for side in range(2):
        hip, knee, ankle = legs[side, 0], legs[side, 1], legs[side, 2]
        longest = REACH * (_distance(rest[knee], rest[hip]) + _distance(rest[ankle], rest[knee]))
        x, z = ankles[side, 0] - placed[hip, 0], ankles[side, 2] - placed[hip, 2]
        room = math.sqrt(max(longest * longest - x * x - z * z, 0.0))
        sink = min(sink, room + ankles[side, 1] - placed[hip, 1])
    thigh, shin = np.empty((3, 3)), np.empty((3, 3))
    for joint in range(len(placed)):
        placed[joint, 1] += sink
    for side in range(2):
        hip, knee, ankle = legs[side, 0], legs[side, 1], legs[side, 2]
        upper, lower = bend(
            placed[hip], placed[knee], placed[ankle], turned[hip, :, 2], ankles[side]
        )
        multiply(upper, turned[hip], thigh)
        multiply(lower, turned[knee], shin)
        multiply_transposed(turned[0], thigh, local[hip])
        multiply_transposed(thigh, shin, local[knee])
        multiply_transposed(shin, turns[side], local[ankle])
    return sink
