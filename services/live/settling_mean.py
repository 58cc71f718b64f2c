"""A mean of what hardly changes while somebody is seen live: learnt at once, then slowly."""

from __future__ import annotations

from typing import Generic, TypeVar

from scene.arrays import Array

_FIRST_S, _LEARNT_S = 1.0, 20.0
"""How a camera stands is learnt at once, then slowly: people lean, nod and read, cameras stand."""

Value = TypeVar("Value", float, Array)


class SettlingMean(Generic[Value]):
    """The running mean of a number or an array; belongs to one thread.

    In the first second each value counts by its share of a second, then by its share of the time
    since the first, from twenty seconds on by its share of twenty.
    """

    def __init__(self, before: Value) -> None:
        """`before` stands until the first value comes."""
        self.value = before
        self._known_s = 0.0

    def add(self, value: Value, step_s: float) -> None:
        """Take in `value`, `step_s` after the last one; the first one counts whole."""
        share = 1.0
        if self._known_s > 0.0:
            share = min(1.0, step_s / min(max(self._known_s, _FIRST_S), _LEARNT_S))
        self._known_s += step_s
        self.value = self.value + share * (value - self.value)
