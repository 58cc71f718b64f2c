"""The eyeballs of the body model, which turn about their middles."""

from __future__ import annotations

import numpy as np

from scene.arrays import Array, Float, Int
from scene.expression import GAZE_RAD
from scene.rotations import axis_angle_to_matrix

EYES = 3, 4
"""Parts of the surface, left and right."""


def eyeballs(faces: Int[Array, "T 3"], parts: Int[Array, "T"]) -> tuple[Int[Array, "A"], ...]:
    """Vertices of the left and of the right one."""
    return tuple(np.unique(faces[parts == eye]) for eye in EYES)


def middle_of(ball: Float[Array, "A 3"]) -> Float[Array, "3"]:
    """About which an eyeball turns, m."""
    return 0.5 * (ball.min(axis=0) + ball.max(axis=0))


def gaze_rotation(gaze_rad: float) -> Float[Array, "3 3"]:
    """Of eyes that look aside by `gaze_rad` (`scene.expression.gaze_of`), at rest."""
    return axis_angle_to_matrix(np.array([0.0, gaze_rad, 0.0]))


def gaze_directions(
    vertices: Float[Array, "V 3"], faces: Int[Array, "T 3"], parts: Int[Array, "T"]
) -> Float[Array, "2 V 3"]:
    """How far (m) `vertices` move as the eyes look left, and right, fully.

    They move along straight lines, which from straight ahead to 30 degrees aside are 0.4 mm off an
    eyeball's arc.
    """
    directions = np.zeros((2, *vertices.shape))
    for number, gaze_rad in enumerate((GAZE_RAD, -GAZE_RAD)):
        turn = gaze_rotation(gaze_rad)
        for ball in eyeballs(faces, parts):
            from_middle = vertices[ball] - middle_of(vertices[ball])
            directions[number, ball] = from_middle @ turn.T - from_middle
    return directions
