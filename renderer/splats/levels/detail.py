"""How many splats each person of a view is drawn by, so that nobody sees it change."""

from __future__ import annotations

from collections.abc import Sequence as Many

import numpy as np

from renderer.splats.levels.tree import LevelTree
from renderer.splats.model import SplatModel
from scene.arrays import Array, Bool

FULL_DENSITY, LEAST_DENSITY = 0.25, 0.03
"""Splats a square of somebody's height in the picture: with more, nothing is gained; with fewer,
they look melted, and a smaller picture serves better."""
MOST_CHANGE = 0.03
"""Share of somebody's splats that come or go from one picture to the next."""
_STEADY = 0.1
"""Share by which somebody's number must be off before it changes: steps nearer and back cost
nothing."""


class ViewDetail:
    """The level of each person in one viewer's pictures, from one to the next.

    A person has so many splats as `density` times the square of their height, px, or all that they
    have: a budget is shared by size on screen.
    """

    def __init__(self) -> None:
        self.density = FULL_DENSITY
        """From `LEAST_DENSITY` to `FULL_DENSITY`."""
        self._people: list[SplatModel] = []
        self._counts: list[int] = []
        self._moving: list[bool] = []
        self._highest = FULL_DENSITY

    @property
    def counts(self) -> list[int]:
        """Splats of each person in the last picture."""
        return list(self._counts)

    @property
    def settled(self) -> bool:
        """Nobody's number is on its way to another."""
        return not any(self._moving)

    @property
    def density_drawn(self) -> float:
        """The densest that anybody was drawn in the last picture: a higher `density` brings
        nothing."""
        return self._highest

    def drawn(
        self, people: Many[tuple[SplatModel, LevelTree | None]], heights_px: Many[float]
    ) -> Bool[Array, "M"]:
        """Which nodes of everybody's levels the next picture shows, one person after the other;
        whose levels are not known yet is drawn whole."""
        chosen = [
            self._next(*one, h, at)
            for at, (one, h) in enumerate(zip(people, heights_px, strict=True))
        ]
        self._people = [model for model, _ in people]
        self._counts, self._moving = [n for n, _ in chosen], [moving for _, moving in chosen]
        densities = (n / max(h, 1.0) ** 2 for n, h in zip(self._counts, heights_px, strict=True))
        self._highest = max(densities, default=FULL_DENSITY)
        return np.concatenate(
            [np.zeros(0, bool)]
            + [
                np.ones(len(model), bool) if tree is None else tree.drawn(count)
                for (model, tree), count in zip(people, self._counts, strict=True)
            ]
        )

    def _next(
        self, model: SplatModel, tree: LevelTree | None, height_px: float, at: int
    ) -> tuple[int, bool]:
        """Somebody's number, and whether it is on its way."""
        if tree is None:
            return len(model), False
        wanted = tree.clamped(self.density * height_px**2)
        if at >= len(self._people) or self._people[at] is not model:
            return wanted, False
        before = self._counts[at]
        if wanted == before or not (self._moving[at] or abs(wanted - before) > _STEADY * before):
            return before, False
        most = max(1, int(MOST_CHANGE * before))
        count = before + int(np.clip(wanted - before, -most, most))
        return count, count != wanted
