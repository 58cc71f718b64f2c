"""Clocks that tests give to trainings, so that no result hangs on how fast a machine is."""

from __future__ import annotations

import itertools
from collections.abc import Callable


def ticking(step_s: float = 0.01) -> Callable[[], float]:
    """A clock that moves on at every look."""
    ticks = itertools.count()
    return lambda: next(ticks) * step_s
