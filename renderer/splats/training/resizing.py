"""How many splats a training has as it goes on: coarse ones, finer ones in their place, merged
ones; with what a checkpoint needs to have as many again."""

from __future__ import annotations

from renderer.splats.training.densification import Densification
from renderer.splats.training.initialisation import FirstSplats
from renderer.splats.training.merging import Grouping
from scene.arrays import Array, Bool


class Resizing:
    """The first splats of a training, changed at most twice."""

    def __init__(self, first: FirstSplats, planned: Densification | None) -> None:
        self._at_first = first if planned is None else planned.coarse
        self._planned = planned
        self._split: Bool[Array, "N"] | None = None
        self._grouping: Grouping | None = None
        self.splats = self._at_first
        """As they lie before training."""

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

    def state(self) -> dict[str, Array]:
        """What `restore` needs."""
        merged = self._grouping
        return {
            **({} if self._split is None else {"split": self._split}),
            **({} if merged is None else {"group": merged.group, "group_light": merged.light}),
        }

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        self._split, self._grouping, self.splats = None, None, self._at_first
        if "split" in state and self._planned is not None:
            self.split(state["split"])
        if "group" in state:
            self.merge(Grouping(state["group"], state["group_light"]))
