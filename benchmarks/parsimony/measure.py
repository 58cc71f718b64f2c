"""Measures the ladder on every subject, in a run that can be cut and gone on with.

Trainings are of a fixed number of steps, so that a busy machine changes their time alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from benchmarks.parsimony.costs import costs
from benchmarks.parsimony.fields import FIELD_LADDER, FieldRung, measured_field
from benchmarks.parsimony.fields import STEPS as FIELD_STEPS
from benchmarks.parsimony.rungs import AS_IT_IS, LADDER, QUICK, Rung, patched
from benchmarks.parsimony.subjects import QUICK as QUICK_SUBJECTS
from benchmarks.parsimony.subjects import SUBJECTS, Filmed, LadderSubject, OutsideData, about
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.measurements import MeasurementCache
from benchmarks.reporting.timing import Clock, clock_named
from renderer.errors import TrainingStopped
from renderer.presets import find_preset
from renderer.splats.files.viewer_file import encode
from renderer.splats.settings import SplatSettings
from renderer.training import train
from scene.sequence import Sequence

STEPS = {"studio": 600, "real": 400, "quick": 60}
_ASKED_EVERY_STEPS = 20
_ACCURACIES = ("_psnr", "_lpips", "_percent")
"""How the names of measures end that say how near a model comes to the truth."""
_R = TypeVar("_R", Rung, FieldRung)


def run(
    writer: FigureWriter, footage: OutsideData, clock_name: str, only: str, *, quick: bool = False
) -> None:
    """Measure what was not measured yet, and report."""
    cache, clock = writer.cache(only), clock_named(clock_name)
    subjects, ladder = (QUICK_SUBJECTS, QUICK) if quick else (SUBJECTS, LADDER)
    rows = []
    for subject in subjects:
        filmed = OnDemand(subject, writer.measurements / "clips", footage)
        rungs = [rung for rung in ladder if subject.real or not rung.real_alone]
        if quick:
            rungs = [replace(rung, seeds=rung.seeds[:1]) for rung in rungs]
        steps = STEPS["quick" if quick else "real" if subject.real else "studio"]

        def splats(rung: Rung, seed: int, f: OnDemand = filmed, s: int = steps) -> dict[str, Any]:
            return measured(rung, seed, s, f(), clock, None)

        def field(rung: FieldRung, seed: int, f: OnDemand = filmed) -> dict[str, Any]:
            return measured_field(rung, seed, FIELD_STEPS, f(), clock)

        rows += measured_rows(cache, subject, rungs, steps, clock, splats)
        if subject.as_field:
            fields = [rung for rung in FIELD_LADDER if rung.fits(real=subject.real)]
            rows += measured_rows(cache, subject, fields, FIELD_STEPS, clock, field)
    figures = {
        **clock.about(),
        "lpips": footage.networks.lpips.name,
        "subjects": [about(subject) for subject in subjects],
        "rows": rows,
        "worth": worth(rows),
    }
    writer.write(figures)


def measured_rows(
    cache: MeasurementCache,
    subject: LadderSubject,
    rungs: Iterable[_R],
    steps: int,
    clock: Clock,
    measure: Callable[[_R, int], dict[str, Any]],
) -> list[dict[str, Any]]:
    """A row a rung and seed of what is stored, or found now by `measure`."""
    rows = []
    for rung in rungs:
        for seed in rung.seeds:
            row = {"subject": subject.name, "group": rung.group, "name": rung.name}
            row |= {"seed": seed, "steps": steps}
            found = cache.measured(
                f"{subject.name}/{rung.group}/{rung.name}/{seed}".replace(" ", "-"),
                {**row, **about(subject), **clock.about()},
                lambda r=rung, s=seed: measure(r, s),
            )
            rows += [] if found is None else [{**row, **found}]
    return rows


class OnDemand:
    """Films once somebody asks: not where all is measured."""

    def __init__(self, subject: LadderSubject, folder: Path, footage: OutsideData) -> None:
        self._subject, self._folder, self._footage = subject, folder, footage
        self._filmed: Filmed | None = None

    def __call__(self) -> Filmed:
        if self._filmed is None:
            self._folder.mkdir(parents=True, exist_ok=True)
            folder = self._folder / self._subject.name
            self._filmed = self._subject.film(folder, self._footage)
        return self._filmed


def measured(
    rung: Rung, seed: int, steps: int, filmed: Filmed, clock: Clock, begun: Path | None
) -> dict[str, Any]:
    """Splats trained so: what they cost, and how near they come to the truth.

    Args:
        begun: folder for trainings that rungs go on from.
    """
    checkpoint = None
    if begun is not None and rung.from_filling:
        checkpoint = _trained_until_filled(filmed.clip, seed, steps, begun)
    began = clock.now()
    with patched(() if rung.captured_anew else rung.patches):
        model = train(
            rung.clip(filmed.clip),
            preset=replace(find_preset("splats"), settings=rung.settings(SplatSettings())),
            iterations=steps,
            seed=seed,
            find_light=rung.find_light,
            size=rung.size,
            checkpoint=checkpoint,
            clock=clock.now if checkpoint is None else _standing,
        ).splats
    training_s = clock.now() - began
    assert model is not None
    return {
        "splats": len(model),
        "viewer_megabytes": round(len(encode(model)) / 1e6, 3),
        "training_s": round(training_s, 2),
        **costs(model, clock),
        **filmed.judged(model),
        **({"size": model.metrics["size"]} if "size" in model.metrics else {}),
    }


def _trained_until_filled(clip: Sequence, seed: int, steps: int, folder: Path) -> Path:
    """The checkpoint in `folder` of a training that has come to where unseen sides are filled."""
    path = folder / f"{clip.data_hash[:12]}-{seed}.npz"
    if not path.exists():
        asked = count(1)
        due = int(SplatSettings().filled_from * steps) // _ASKED_EVERY_STEPS
        with suppress(TrainingStopped):
            train(
                clip,
                iterations=steps,
                seed=seed,
                find_light=True,
                should_stop=lambda: next(asked) >= due,
                checkpoint=path,
                clock=_standing,
            )
    return path


def _standing() -> float:
    """A clock that stands still: a training writes no checkpoint but when it is stopped, and asks
    whether to stop after each `_ASKED_EVERY_STEPS`."""
    return 0.0


def worth(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of each part that was left out, what all together are better by, with its standard deviation
    over seeds: a row a subject and part."""
    found = []
    for subject, name in dict.fromkeys(
        (row["subject"], row["name"]) for row in rows if row["group"] == "without"
    ):
        whole = _of(rows, subject, AS_IT_IS.group, AS_IT_IS.name)
        lacking = _of(rows, subject, "without", name)
        both = [(whole[seed], lacking[seed]) for seed in whole if seed in lacking]
        if not both:
            continue
        row: dict[str, Any] = {"subject": subject, "name": name, "seeds": len(both)}
        for measure in both[0][0]:
            if not measure.endswith(_ACCURACIES):
                continue
            if all(row[measure] is not None for pair in both for row in pair):
                apart = [one[measure] - other[measure] for one, other in both]
                row[measure] = round(float(np.mean(apart)), 4)
                row[f"{measure}_spread"] = round(float(np.std(apart)), 4)
        found.append(row)
    return found


def _of(rows: list[dict[str, Any]], subject: str, group: str, name: str) -> dict[int, Any]:
    key = (subject, group, name)
    return {r["seed"]: r for r in rows if (r["subject"], r["group"], r["name"]) == key}
