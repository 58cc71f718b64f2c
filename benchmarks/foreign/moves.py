"""How the figure moves: once round before the camera, arms and legs swinging; and another dance.

Angles are chosen by hand and run smoothly through time; nothing is random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From the body's axes (y up) to the room's (z up)."""
_SOLE_M = 1.225
"""How far below the body's origin its soles are at rest."""


@dataclass(frozen=True)
class Move:
    """One moment. x_room = rotation(turn) (x_body) + place; the pelvis rests at its joint."""

    turn: Array
    """Axis-angle of the body in the room [3]."""
    place: Array
    """[3] m"""
    angles: Array
    """Axis-angle of every joint against its parent [24, 3]; the pelvis's is nil."""


def turning(count: int) -> list[Move]:
    """Once round on the spot, a step every eighth of the turn."""
    return [_turning(i / count) for i in range(count)]


def dancing(count: int) -> list[Move]:
    """Other gestures: arms raised and bent, a deep knee, a bow to each side."""
    return [_dancing(i / count) for i in range(count)]


def rotation(axis_angle: Array) -> Array:
    """Matrix [3, 3] of one axis-angle, by the exponential's closed form."""
    angle = float(np.linalg.norm(axis_angle))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = axis_angle / angle
    c, s = np.cos(angle), np.sin(angle)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return c * np.eye(3) + s * cross + (1.0 - c) * np.outer([x, y, z], [x, y, z])


def _turning(t: float) -> Move:
    w = 2.0 * np.pi * t
    step, sway = np.sin(8.0 * w), np.sin(4.0 * w + 0.4)
    angles = np.zeros((24, 3))
    _arms(angles, 1.12 + 0.16 * np.sin(3.0 * w), 1.05 + 0.2 * np.cos(2.0 * w), 0.35 * step, 0.3)
    _legs(angles, 0.22 * step, 0.28)
    angles[[3, 6, 9], 1] = 0.05 * sway
    angles[[3, 6], 2] = 0.03 * step
    angles[12] = [0.08 * np.sin(w), 0.22 * np.sin(2.0 * w), 0.0]
    angles[15] = [0.06 * np.cos(3.0 * w), 0.1 * sway, 0.05 * step]
    return _standing(w, np.array([0.06 * np.sin(w), 0.05 * np.cos(w)]), angles, 0.012 * abs(step))


def _dancing(t: float) -> Move:
    w = 2.0 * np.pi * t
    angles = np.zeros((24, 3))
    _arms(angles, 0.35 + 0.75 * np.sin(w), 0.45 + 0.7 * np.cos(w), 0.25 * np.sin(2.0 * w), 0.9)
    _legs(angles, 0.45 * np.sin(2.0 * w + 0.5), 0.6)
    angles[[3, 6, 9], 2] = 0.1 * np.sin(w)
    angles[[3, 6], 0] = 0.08 * np.cos(2.0 * w)
    angles[12, 1] = 0.4 * np.sin(w)
    return _standing(1.3 + 2.0 * w, np.zeros(2), angles, 0.05)


def _arms(angles: Array, left: float, right: float, swing: float, bend: float) -> None:
    """Lowered from the T-pose by `left` and `right`, swung apart, and bent at the elbow."""
    for side, down, forth in ((1.0, left, swing), (-1.0, right, -swing)):
        first = 0 if side > 0.0 else 1
        lowered = rotation(np.array([-forth, 0.0, 0.0])) @ rotation(
            np.array([0.0, 0.0, -side * (down - 0.08)])
        )
        angles[16 + first] = _logarithm(lowered)
        angles[13 + first, 2] = -0.08 * side
        angles[18 + first] = np.array([0.0, -side, 0.25 * side]) * (bend + 0.6 * max(forth, 0.0))
        angles[20 + first] = [0.12 * forth, 0.0, -0.1 * side]


def _legs(angles: Array, swing: float, knee: float) -> None:
    for first, forth in ((0, swing), (1, -swing)):
        bend = knee * max(0.0, forth / 0.3) + 0.05
        angles[1 + first, 0] = -forth - 0.3 * bend
        angles[4 + first, 0] = bend
        angles[7 + first, 0] = 0.4 * forth - 0.4 * bend


def _standing(azimuth: float, spot: Array, angles: Array, lift_m: float) -> Move:
    about_up = rotation(np.array([0.0, 0.0, azimuth]))
    place = np.array([spot[0], spot[1], _SOLE_M - lift_m])
    return Move(_logarithm(about_up @ _UPRIGHT), place, angles)


def _logarithm(matrix: Array) -> Array:
    """The axis-angle of a rotation, from the eigenvector that it leaves alone."""
    cosine = np.clip(0.5 * (np.trace(matrix) - 1.0), -1.0, 1.0)
    angle = float(np.arccos(cosine))
    if angle < 1e-9:
        return np.zeros(3)
    axis = np.linalg.svd(matrix - np.eye(3))[2][-1]
    trial = min((axis, -axis), key=lambda a: float(np.abs(rotation(angle * a) - matrix).max()))
    return angle * trial
