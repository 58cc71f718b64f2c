"""Eyeballs that look about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.body.model import EYES
from scene.arrays import Array, Float, Int
from scene.body import Body
from scene.rotations import axis_angle_to_matrix

_FIXATION_S = 0.7
"""How long eyes rest on one place."""
_YAW_RAD, _PITCH_RAD = 0.35, 0.15
"""How far they turn aside, up and down."""
_IRIS_CENTRE = np.array([0.703, 0.705])
"""In MakeHuman's pictures of eyes, right and up."""
_PICTURE_PER_RAD = 0.222
"""How far from there an eyeball's place is, a radian off the pupil: an iris ends at 0.52 rad."""


def gaze_at(time_s: float, seed: int) -> Float[Array, "2"]:
    """Where the eyes of the performer `seed` look at `time_s`: yaw to their left and pitch down,
    rad, from straight ahead."""
    fixation = int(max(time_s, 0.0) / _FIXATION_S)
    rng = np.random.default_rng([seed, fixation])
    return rng.uniform(-1.0, 1.0, 2) * [_YAW_RAD, _PITCH_RAD]


@dataclass(frozen=True, eq=False)
class Eyes:
    """Both eyeballs of a body."""

    vertices: tuple[Int[Array, "A"], ...]
    """Of the left eye and of the right."""
    centres: Float[Array, "2 3"]
    """At rest, m."""

    @classmethod
    def of(cls, body: Body, parts: Int[Array, "T"]) -> Eyes:
        """The eyes of `body`, whose triangles are of `parts`."""
        assert body.rest_vertices is not None
        assert body.faces is not None
        vertices = tuple(np.unique(body.faces[parts == eye]) for eye in EYES)
        balls = [body.rest_vertices[of_eye] for of_eye in vertices]
        return cls(
            vertices, np.stack([0.5 * (ball.min(axis=0) + ball.max(axis=0)) for ball in balls])
        )

    def turned(self, rest: Float[Array, "N 3"], gaze: Float[Array, "2"]) -> Float[Array, "N 3"]:
        """`rest` vertices with both eyeballs turned by `gaze` (yaw, pitch), rad."""
        yaw, pitch = gaze
        turn = axis_angle_to_matrix(np.array([0.0, yaw, 0.0])) @ axis_angle_to_matrix(
            np.array([pitch, 0.0, 0.0])
        )
        turned = rest.copy()
        for vertices, centre in zip(self.vertices, self.centres, strict=True):
            turned[vertices] = (rest[vertices] - centre) @ turn.T + centre
        return turned

    def texture(self, rest: Float[Array, "N 3"]) -> Float[Array, "N 2"]:
        """Places of the eyeballs' vertices in a picture of an eye; 0 for all others."""
        places = np.zeros((len(rest), 2))
        for vertices, centre in zip(self.vertices, self.centres, strict=True):
            x, y, z = (rest[vertices] - centre).T
            sideways = np.hypot(x, y)
            off_pupil = np.minimum(np.arctan2(sideways, z), 1.2)
            scale = _PICTURE_PER_RAD * off_pupil / np.maximum(sideways, 1e-9)
            places[vertices] = _IRIS_CENTRE + scale[:, None] * np.stack([x, y], axis=1)
        return places
