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

from renderer.splats.layout import COLOUR, POSITION
from renderer.splats.training.surface_kinds import KINDS
from scene.arrays import Array, Bool, Float, Int

_HANDS = KINDS.index("hands")
_COLOURS, _PLACE = slice(COLOUR, COLOUR + 3), slice(POSITION, POSITION + 3)
_PULLS = np.array([0.05, 0.05, 0.005], np.float32)
"""Shares of the difference that a step takes back: of colours, places and shapes."""
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
        from renderer.splats.training.pull_kernels import mean_of_neighbours, pull_hands

        if not moved[self._rows].any():
            return
        mine = parameters[self._rows]
        own = np.concatenate(
            [mine[:, _COLOURS], mine[:, _PLACE] - surface[self._rows, _PLACE]], axis=1
        )
        near, around = np.empty_like(own), np.empty_like(own)
        edges = (self._mean.indptr, self._mean.indices, self._mean.data)
        mean_of_neighbours(*edges, own, near)
        mean_of_neighbours(*edges, near, around)
        pull_hands(parameters, surface, self._rows, own, around, _ROUGHNESS_M, _PULLS, moved)
