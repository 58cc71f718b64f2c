"""When clicks are heard and lips are seen to part, found in what was played and shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.lipsync.talker import OPEN_S, PERIOD_S
from scene.arrays import Array, Float

_LOUD_SHARE = 0.4
"""Of the loudest: a click."""
_PLATEAU_S = (0.25, 0.40)
"""After the click in which the mouth is surely open, whichever of both is late."""
_CLOSED_S = (0.80, 1.0)
_HALF = 0.5
_SEARCHED_S = 0.4
"""So long before and after a click lips are looked for."""


@dataclass(frozen=True, eq=False)
class Sound:
    """Peaks of short blocks."""

    times_s: Float[Array, "N"]
    """When each begins."""
    peaks: Float[Array, "N"]


@dataclass(frozen=True, eq=False)
class Shown:
    """Pictures."""

    times_s: Float[Array, "P"]
    """When each comes to be seen."""
    pictures: Float[Array, "P H W"]


def clicks_heard(sound: Sound) -> Float[Array, "C"]:
    """When each click begins, s."""
    loud = sound.peaks > _LOUD_SHARE * sound.peaks.max(initial=0.0)
    found: list[float] = []
    for time_s in sound.times_s[loud]:
        if not found or time_s - found[-1] > 0.5 * PERIOD_S:
            found.append(float(time_s))
    return np.array(found)


def openings_seen(shown: Shown, clicks_s: Float[Array, "C"]) -> Float[Array, "C"]:
    """When lips come to be half apart, s, about each click; NaN where they do not.

    What opening looks like is learnt from the pictures themselves: the mean of those in which it
    must be open, less the mean of those in which it must be closed.
    """
    since = (shown.times_s[:, None] - clicks_s[None]).T
    opened, closed = (
        shown.pictures[((since > low) & (since < high)).any(axis=0)].mean(axis=0)
        for low, high in (_PLATEAU_S, _CLOSED_S)
    )
    change = opened - closed
    apart = np.einsum("phw,hw->p", shown.pictures - closed, change) / np.square(change).sum()
    found = np.full(len(clicks_s), np.nan)
    for number, times_s in enumerate(since):
        near = np.flatnonzero(np.abs(times_s) < _SEARCHED_S)
        rising = [at for at in near[1:] if apart[at] >= _HALF > apart[at - 1]]
        if rising:
            found[number] = shown.times_s[rising[0]]
    return found


def lateness(sound: Sound, shown: Shown, first_opening_s: float | None = None) -> dict[str, Any]:
    """How much later lips are seen than the voice is heard, ms; with the moment of the first
    opening by the same clock, also how old both are."""
    clicks_s = clicks_heard(sound)
    # what begins or ends within what was witnessed can't be judged
    whole = clicks_s - _SEARCHED_S > shown.times_s[0]
    clicks_s = clicks_s[whole & (clicks_s + OPEN_S < shown.times_s[-1])]
    seen_s = openings_seen(shown, clicks_s)
    known = ~np.isnan(seen_s)
    late_ms = 1e3 * (seen_s - clicks_s)[known]
    figures: dict[str, Any] = {
        "openings": int(known.sum()),
        "missed": int((~known).sum()),
        "lips_after_voice_p50_ms": _at(late_ms, 50.0),
        "lips_after_voice_p5_ms": _at(late_ms, 5.0),
        "lips_after_voice_p95_ms": _at(late_ms, 95.0),
    }
    if first_opening_s is not None:
        for name, times_s in (("voice", clicks_s), ("lips", seen_s[known])):
            age_ms = 1e3 * np.mod(times_s - first_opening_s, PERIOD_S)
            figures[f"{name}_age_p50_ms"] = _at(age_ms, 50.0)
    return figures


def _at(values: Float[Array, "N"], percentile: float) -> int | None:
    return round(float(np.percentile(values, percentile))) if len(values) else None
