"""Eyeballs that turn, and the picture on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.body.eyes import eyeballs, gaze_rotation, middle_of
from scene.arrays import Array, Float, Int
from scene.body import Body

_IRIS_CENTRE = np.array([0.703, 0.705])
"""In MakeHuman's pictures of eyes, right and up."""
_PICTURE_PER_RAD = 0.222
"""How far from there an eyeball's place is, a radian off the pupil: an iris ends at 0.52 rad."""


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
        vertices = eyeballs(body.faces, parts)
        return cls(vertices, np.stack([middle_of(body.rest_vertices[ball]) for ball in vertices]))

    def turned(self, rest: Float[Array, "N 3"], gaze_rad: float) -> Float[Array, "N 3"]:
        """`rest` vertices with both eyeballs turned to the person's left by `gaze_rad`."""
        turn, turned = gaze_rotation(gaze_rad), rest.copy()
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
