"""Where the paper's own field fails, on a GPU, and where splats of the same clips do.

Trainings share the GPU: a field's step waits for launches half of the time, so several together are
sooner done than one after the other. They are counted in steps, so that nothing of it shows.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import clock_named
from benchmarks.stability.axes import FIELD_AXES, TRAINING_AXES
from benchmarks.stability.axis import TrainingAxis
from benchmarks.stability.breaking import row_of
from benchmarks.stability.judge import guarded
from benchmarks.stability.material import Material
from benchmarks.stability.subjects import PAINTED, SubjectSources, studio_subjects
from benchmarks.stability.trainings import Method, SplatEffort, measure_training
from renderer.evaluation.lpips import PACKAGED_BACKBONE, Lpips
from renderer.presets import EXACT

PAPER = "paper"
_AXES = {axis.name: axis for axis in TRAINING_AXES}
_PROCESSES = 14
"""At most: their contexts are all on one GPU."""


@dataclass(frozen=True)
class PaperEffort(SplatEffort):
    """How much is measured."""

    preset: str = "+".join([PAPER, *EXACT])
    paper_iterations: int = 2500
    steps: int = 3
    axes: tuple[str, ...] = FIELD_AXES

    def methods(self, axis: TrainingAxis) -> tuple[Method, Method]:
        """The paper's field and splats: poses that are off are refined, others believed."""
        splats = self.refining if axis.poses_off else self.exact
        field = replace(splats, name=PAPER, preset=self.preset, iterations=self.paper_iterations)
        return field, splats


@dataclass(frozen=True)
class _Training:
    """One measurement, as a process of its own is told of it."""

    axis: str
    step: float
    method: Method
    inputs: SubjectSources
    strip: Path

    @property
    def of(self) -> TrainingAxis:
        """The axis: what spoils a clip is a function, which not every process can be sent."""
        return _AXES[self.axis]

    @property
    def name(self) -> str:
        """Of the measurement; undisturbed, it is that of every axis with such poses."""
        axis = self.of
        undisturbed = self.step == axis.steps[0]
        what = "undisturbed" if undisturbed else f"{self.axis} {axis.label(self.step)}"
        return f"{what}, {self.method.name} {self.method.trust}"


def run(writer: FigureWriter, inputs: SubjectSources, device: str, effort: PaperEffort) -> None:
    """Measure what was not measured yet, and report.

    Args:
        device: what fields are trained and drawn on, in words.
    """
    began_s = time.monotonic()
    next(studio_subjects(inputs, lambda: True))  # filmed once, before processes open the clip
    trainings = list(_trainings(writer, inputs, effort))
    processes = min(_PROCESSES, os.cpu_count() or 1)
    spawning = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(processes, mp_context=spawning) as pool,
        ThreadPoolExecutor(processes) as waiting,
    ):
        named = {one.name: one for one in sorted(trainings, key=lambda one: -one.method.iterations)}
        found = waiting.map(lambda one: _stored_or_measured(writer, pool, one), named.values())
        by_name = dict(zip(named, found, strict=True))
    rows = [
        row_of(one.of, one.step, PAINTED, one.method.name, by_name[one.name]) for one in trainings
    ]
    writer.write(
        {
            "device": device,
            "frames": inputs.frames,
            "size": inputs.size_px,
            "paper_iterations": effort.paper_iterations,
            "splats_iterations": [effort.iterations, effort.refining_iterations],
            "seconds": round(time.monotonic() - began_s, 1),
            "rows": rows,
        }
    )


def _trainings(
    writer: FigureWriter, inputs: SubjectSources, effort: PaperEffort
) -> Iterator[_Training]:
    for name in effort.axes:
        axis = _AXES[name]
        for method in effort.methods(axis):
            for step in axis.chosen(effort.steps):
                strip = writer.measurements / "strips" / f"{name} {step:g} {method.name}.png"
                yield _Training(name, step, method, inputs, strip)


def _stored_or_measured(
    writer: FigureWriter, pool: ProcessPoolExecutor, training: _Training
) -> dict[str, Any]:
    """The figures; a process that dies is an outcome too."""
    of = {
        "iterations": training.method.iterations,
        "size": training.inputs.size_px,
        "frames": training.inputs.frames,
    }
    found = writer.cache().measured(
        training.name, of, lambda: guarded(pool.submit(_measured, training).result)
    )
    assert found is not None
    return found


def _measured(training: _Training) -> dict[str, Any]:
    clock, axis = clock_named("processor"), training.of
    subject = next(studio_subjects(training.inputs, lambda: True))

    def spoilt() -> Material:
        return axis.spoil(subject, training.step, axis.rng())

    lpips = Lpips(PACKAGED_BACKBONE)
    return measure_training(training.method, spoilt, lpips, clock.now, training.strip)
