"""An axis: one thing that is disturbed, in steps from not at all to beyond reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from benchmarks.stability.material import Material, Subject

Spoil = Callable[[Subject, float, np.random.Generator], Material]
"""The subject's material disturbed by an amount. The generator is the same for every amount, so
that a larger one does more of the same and curves do not turn by chance."""


@dataclass(frozen=True)
class Axis:
    """What is disturbed, and how much."""

    name: str
    words: str
    """In the table; the unit of its steps is in `unit`."""
    group: str
    """Chart that its curve stands in."""
    steps: tuple[float, ...]
    """The first is undisturbed, the last beyond reason."""
    unit: str = ""
    labels: tuple[str, ...] = field(default=(), kw_only=True)
    """In place of numbers."""
    every_step: bool = field(default=False, kw_only=True)
    """All steps are measured, with the first performer alone."""

    has_floor: ClassVar[bool] = True
    """Whether pictures below some quality are no use, whatever they were undisturbed."""

    def label(self, step: float) -> str:
        """A step as tables and charts name it."""
        if self.labels:
            return self.labels[self.steps.index(step)]
        return f"{step:g}{self.unit}"

    def chosen(self, count: int) -> tuple[float, ...]:
        """`count` of the steps, the first and the last among them; all where there are fewer."""
        count = len(self.steps) if self.every_step else count
        places = np.linspace(0, len(self.steps) - 1, min(count, len(self.steps)))
        return tuple(self.steps[round(float(place))] for place in places)

    def rng(self) -> np.random.Generator:
        """Chance of this axis."""
        return np.random.default_rng(list(self.name.encode()))


@dataclass(frozen=True)
class TrainingAxis(Axis):
    """Spoils what a model is trained on."""

    spoil: Spoil = field(kw_only=True)
    filmed_anew: bool = field(default=False, kw_only=True)
    """Needs a performer who can be filmed again."""
    in_loose_clothes: bool = field(default=False, kw_only=True)
    """Needs a performer whom the studio has loose clothes for."""
    of_pictures: bool = field(default=False, kw_only=True)
    """Also measured with real people."""
    poses_off: bool = field(default=False, kw_only=True)
    """Poses, bodies or cameras are disturbed: they count as estimated, and training refines them.
    Else they are exact and believed, so that nothing else is at work."""
    believed_too: bool = field(default=False, kw_only=True)
    """Also measured with poses that are off and believed."""
