"""How many splats a training has as it goes on: coarse ones, finer ones in their place, merged
ones, finer sides; with what a checkpoint needs to have as many again."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from renderer.errors import OutdatedCheckpoint
from renderer.splats.layout import POSITION
from renderer.splats.training.densification import Densification
from renderer.splats.training.initialisation import FirstSplats
from renderer.splats.training.merging import Grouping
from scene.arrays import Array, Bool, Float

_SAME_M = 1e-4
"""Distance up to which first places are the same ones, on another processor."""


class Resizing:
    """The first splats of a training, changed at most three times."""

    def __init__(self, first: FirstSplats, planned: Densification | None) -> None:
        self._at_first = first if planned is None else planned.coarse
        self._planned = planned
        self._split: Bool[Array, "N"] | None = None
        self._grouping: Grouping | None = None
        self._finer: Bool[Array, "N"] | None = None
        self.splats = self._at_first
        """As they lie before training."""

    @property
    def _places(self) -> Float[Array, "N 3"]:
        return self._at_first.parameters[:, POSITION : POSITION + 3]

    @property
    def awaited(self) -> Densification | None:
        """Finer splats that have yet to take the place of coarse ones."""
        return self._planned if self._split is None else None

    def split(self, split: Bool[Array, "N"]) -> None:
        """Put finer ones in the place of those to `split`."""
        assert self._planned is not None
        self._split, self.splats = split, self._planned.splats(split)

    def merge(self, grouping: Grouping) -> None:
        """Put one in the place of each group."""
        self._grouping, self.splats = grouping, grouping.merged_first(self.splats)

    @property
    def refinable(self) -> bool:
        """Not refined yet."""
        return self._finer is None

    def refine(self, planned: Densification, split: Bool[Array, "N"]) -> None:
        """Put those of `planned`, whose coarse splats are the present ones, in the place of those
        to `split`."""
        self._finer, self.splats = split, planned.splats(split)

    def state(self) -> dict[str, Array]:
        """What `restore` needs."""
        merged = self._grouping
        return {
            "places": self._places.copy(),
            **({} if self._split is None else {"split": self._split}),
            **({} if self._finer is None else {"finer": self._finer}),
            **({} if merged is None else {"group": merged.group, "group_light": merged.light}),
        }

    def restore(self, state: dict[str, Array], finer: Callable[[], FirstSplats]) -> None:
        """Go back to `state`; `finer` makes the layer that was refined with.

        Raises OutdatedCheckpoint where it began with splats in other places.
        """
        places = state.get("places", np.zeros((0, 3), np.float32))
        known = places.shape == self._places.shape
        if not known or not np.allclose(places, self._places, rtol=0.0, atol=_SAME_M):
            raise OutdatedCheckpoint(
                f"checkpoint must begin with the {len(self._places)} splats that this version "
                f"places on the clip; got {len(places)} in other places"
            )
        self._split, self._grouping, self._finer = None, None, None
        self.splats = self._at_first
        if "split" in state and self._planned is not None:
            self.split(state["split"])
        if "group" in state:
            self.merge(Grouping(state["group"], state["group_light"]))
        if "finer" in state:
            self.refine(Densification(self.splats, finer()), state["finer"])
