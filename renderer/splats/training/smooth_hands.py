"""Hands that stay hands in poses that no frame shows.

Fingers are small, blurred by their motion, and hardly ever where the estimated pose has them.
Splats that may take any colour, place and size learn whatever pixels lie there instead: in the
frames of the clip that looks right, in any other pose it is a scab. So each step draws what moved
towards its neighbours: colours, and how far a splat lies off the surface; sizes, rotations and
opacities go back to those of the surface. The pull is a share of the difference, and Adam's own
steps are the shorter the less frames agree: what all of them show, such as nails or a ring,
resists.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION, ROTATION
from renderer.splats.training.surface_kinds import KINDS
from scene.arrays import Array, Bool, Float, Int

_HANDS = KINDS.index("hands")
_COLOURS, _PLACE = slice(COLOUR, COLOUR + 3), slice(POSITION, POSITION + 3)
_SHAPES = (slice(LOG_SCALE, LOG_SCALE + 3), slice(ROTATION, ROTATION + 4), OPACITY)
_COLOUR_PULL, _PLACE_PULL, _SHAPE_PULL = np.float32(0.05), np.float32(0.05), np.float32(0.005)
"""Shares of the difference that a step takes back."""
_ROUGHNESS_M = 0.003
"""How far a splat may stand out from those beside it; less would keep palms from having creases."""


class SmoothHands:
    """The splats of a training that lie on hands."""

    def __init__(self, kinds: Int[Array, "N"], mean_of_neighbours) -> None:
        """Args:
        kinds: index into `KINDS`.
        mean_of_neighbours: [N N], see `neighbours.mean_of_neighbours`.
        """
        self._rows = np.flatnonzero(kinds == _HANDS)
        edges = mean_of_neighbours[self._rows][:, self._rows]
        # those of the wrist have some neighbours that are no hand's
        share = np.maximum(np.asarray(edges.sum(axis=1)), 1e-6)
        self._mean = edges.multiply(1.0 / share).tocsr().astype(np.float32)

    def pull(
        self, parameters: Float[Array, "N P"], surface: Float[Array, "N P"], moved: Bool[Array, "N"]
    ) -> None:
        """Draw those that `moved` towards their neighbours and the surface, in place."""
        moving = moved[self._rows]
        rows = self._rows[moving]
        if not len(rows):
            return
        own, first = parameters[self._rows], surface[self._rows]
        colours, away = own[:, _COLOURS], own[:, _PLACE] - first[:, _PLACE]
        parameters[rows, _COLOURS] += _COLOUR_PULL * self._towards_neighbours(colours)[moving]
        gap = self._towards_neighbours(away)[moving]
        length = np.linalg.norm(gap, axis=1, keepdims=True)
        gap *= np.maximum(1.0 - _ROUGHNESS_M / np.maximum(length, 1e-9), 0.0)
        parameters[rows, _PLACE] += _PLACE_PULL * gap.astype(np.float32)
        for shape in _SHAPES:
            parameters[rows, shape] += _SHAPE_PULL * (first - own)[moving, shape]

    def _towards_neighbours(self, values: Float[Array, "M C"]) -> Float[Array, "M C"]:
        """From each value to the mean of those beside its neighbours."""
        return self._mean @ (self._mean @ values) - values
