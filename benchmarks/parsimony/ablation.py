"""Measures every part of `PARTS` on its people, in a run that can be cut and gone on with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.parsimony.measure import STEPS, OnDemand, measured, measured_rows, worth
from benchmarks.parsimony.parts import PARTS, WHOLE
from benchmarks.parsimony.people import PEOPLE, RealPerson
from benchmarks.parsimony.rungs import Rung
from benchmarks.parsimony.subjects import Filmed, LadderSubject, OutsideData, about
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import clock_named


def run(writer: FigureWriter, footage: OutsideData, clock_name: str, only: str) -> None:
    """Measure what was not measured yet, and report."""
    cache, clock = writer.cache(only), clock_named(clock_name)
    rows = []
    for subject in PEOPLE.values():
        rungs = [WHOLE, *(part.rung for part in PARTS if subject.name in part.people)]
        films = _Films(subject, writer.measurements / "clips", footage)
        begun = writer.measurements / "begun"

        def measure(rung: Rung, seed: int, f: _Films = films, b: Path = begun) -> dict[str, Any]:
            return measured(rung, seed, STEPS["real"], f(rung), clock, b)

        rows += measured_rows(cache, subject, rungs, STEPS["real"], clock, measure)
    figures = {
        **clock.about(),
        "lpips": footage.networks.lpips.name,
        "people": [about(subject) for subject in PEOPLE.values()],
        "rows": rows,
        "worth": worth(rows),
    }
    writer.write(figures)


class _Films:
    """What each rung is trained on: one clip, but for those that have it captured anew."""

    def __init__(self, subject: LadderSubject, folder: Path, footage: OutsideData) -> None:
        self._subject, self._folder, self._footage = subject, folder, footage
        self._whole = OnDemand(subject, folder, footage)
        self._anew: dict[str, OnDemand] = {}

    def __call__(self, rung: Rung) -> Filmed:
        if not rung.captured_anew:
            return self._whole()
        if rung.name not in self._anew:
            film = self._subject.film
            assert isinstance(film, RealPerson)
            name = f"{self._subject.name}-without-{rung.name}".replace(" ", "-")
            changed = replace(self._subject, name=name, film=replace(film, without=rung.patches))
            self._anew[rung.name] = OnDemand(changed, self._folder, self._footage)
        return self._anew[rung.name]()
