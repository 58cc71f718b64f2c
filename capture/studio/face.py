"""Surfaces that only a moving face shows: eyeballs under the lids, a dark mouth with a tongue.

A face at rest has its eyes painted on the skin; closing lids need eyeballs of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.body.eyes import EYES
from capture.body.model import MOUTH, TONGUE
from scene.arrays import Array, Float, Int
from scene.body import Body

_INSIDE = np.array([0.2, 0.06, 0.07])
_TONGUE = np.array([0.62, 0.27, 0.28])
_WHITE = np.array([0.97, 0.97, 0.97])
_IRIS = np.array([0.16, 0.24, 0.3])
_IRIS_M = 0.0065


@dataclass(frozen=True, eq=False)
class Face:
    """The parts of a body's surface that only a moving face shows."""

    parts: Int[Array, "T"]
    """Of each triangle, see `capture.body.model`."""
    eyes: Float[Array, "2 3"]
    """Centres of the eyes at rest, left and right, m."""

    @classmethod
    def of(cls, body: Body, parts: Int[Array, "T"]) -> Face:
        """The face of `body`, whose triangles are of `parts`."""
        assert body.rest_vertices is not None
        assert body.faces is not None
        eyeballs = [body.rest_vertices[np.unique(body.faces[parts == eye])] for eye in EYES]
        return cls(parts, np.stack([0.5 * (b.min(axis=0) + b.max(axis=0)) for b in eyeballs]))

    def paint(
        self, colour: Float[Array, "N 3"], triangle: Int[Array, "N"], rest: Float[Array, "N 3"]
    ) -> None:
        """Colour, in place, the samples at `rest`, on each `triangle`, that are not skin."""
        part = self.parts[triangle]
        colour[part == MOUTH] = _INSIDE
        colour[part == TONGUE] = _TONGUE
        for eye, centre in zip(EYES, self.eyes, strict=True):
            colour[part == eye] = _WHITE
            distance = np.hypot(rest[:, 0] - centre[0], rest[:, 1] - centre[1])
            colour[(part == eye) & (distance < _IRIS_M) & (rest[:, 2] > centre[2])] = _IRIS
