"""Everything that is disturbed, one thing at a time: measured, summed up and drawn."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import Clock, clock_named
from benchmarks.stability import live
from benchmarks.stability.axes import FIELD_AXES, TRAINING_AXES
from benchmarks.stability.axis import Axis, TrainingAxis
from benchmarks.stability.breaking import (
    LEAST_DB,
    LOST_DB,
    LOST_LPIPS,
    MOST_LPIPS,
    Row,
    row_of,
)
from benchmarks.stability.captures import CAPTURE_AXES, CaptureAxis, CaptureBench
from benchmarks.stability.judge import MEASURED
from benchmarks.stability.live import LIVE_AXES, LiveAxis
from benchmarks.stability.material import Material, Subject
from benchmarks.stability.sheet import WorstPicture, draw_sheet
from benchmarks.stability.subjects import PAINTED, SubjectSources, filmed_subjects, studio_subjects
from benchmarks.stability.trainings import Method, SplatEffort, measure_training
from capture.detection.landmarks import MediaPipeEstimator
from renderer.evaluation.lpips import PACKAGED_BACKBONE, Lpips
from renderer.model_files import load_model, save_model
from renderer.performer_model import PerformerModel
from renderer.training import train
from scene.sequence import PoseTrust

AXES: dict[str, Axis] = {axis.name: axis for axis in (*TRAINING_AXES, *CAPTURE_AXES, *LIVE_AXES)}
BELIEVED, FIELD = "splats, poses believed", "fast"
QUICK_AXES = ("pose_noise", "mask_lost", "sensor_noise", "silence")
_NOTHING = "\0"
"""In no measurement's name."""
_SHEET = 32
"""Pictures on the sheet."""
_A = TypeVar("_A", bound=Axis)


@dataclass(frozen=True)
class StabilityEffort(SplatEffort):
    """How much is measured."""

    steps: int = 3
    """Of each axis, the undisturbed one among them."""
    field_iterations: int = 600
    axes: tuple[str, ...] = tuple(AXES)

    @property
    def believing(self) -> Method:
        """The same without refining: what that is worth."""
        return replace(self.refining, name=BELIEVED, believes_poses=True)

    @property
    def of_a_field(self) -> Method:
        """A field, which takes poses as they are."""
        return Method(FIELD, FIELD, self.field_iterations, believes_poses=False, aligned=True)


QUICK = StabilityEffort(iterations=120, refining_iterations=320, axes=QUICK_AXES)


@dataclass(eq=False)
class Bench:
    """One run: what it measures with, and what it has measured."""

    writer: FigureWriter
    inputs: SubjectSources
    effort: StabilityEffort
    only: str
    until_s: float
    """Of the monotonic clock: when no other measurement is begun."""
    clock: Clock = field(default_factory=lambda: clock_named("processor"))
    lpips: Lpips = field(default_factory=lambda: Lpips(PACKAGED_BACKBONE))
    rows: list[Row] = field(default_factory=list)
    strips: list[Path] = field(default_factory=list)
    """Of each row, where its worst picture is."""
    missing: int = 0
    """Measurements that were left out, by `only` or for want of time."""

    def measure_all(self) -> None:
        """What costs least and says most first: a run may be cut by time."""
        training = self._axes(TRAINING_AXES)
        exact = [axis for axis in training if not axis.poses_off]
        off = [axis for axis in training if axis.poses_off]
        performers = studio_subjects(self.inputs, self._may_begin)
        first = next(performers)
        self._trainings(first, exact)
        self._meetings(first)
        self._trainings(first, off)
        others = list(performers)
        for subject in others:
            self._trainings(subject, exact)
        self._captures()
        for subject in filmed_subjects(self.inputs, self._may_begin):
            self._trainings(subject, [axis for axis in training if axis.of_pictures])
        for subject in others:
            self._trainings(subject, off)
        self._fields(first)

    def _may_begin(self) -> bool:
        """There is time for another measurement."""
        return time.monotonic() <= self.until_s

    def _axes(self, axes: tuple[_A, ...]) -> list[_A]:
        return [axis for axis in axes if axis.name in self.effort.axes]

    def _trainings(self, subject: Subject, axes: list[TrainingAxis]) -> None:
        for axis in axes:
            if self._suits(axis, subject):
                for method in self._methods(axis, subject):
                    self._training(axis, subject, method)

    def _suits(self, axis: TrainingAxis, subject: Subject) -> bool:
        stage = subject.stage
        if axis.in_loose_clothes:
            return stage is not None and bool(stage.performer.garments)
        if axis.every_step:
            return subject.name == PAINTED
        return stage is not None or not axis.filmed_anew

    def _training(self, axis: TrainingAxis, subject: Subject, method: Method) -> None:
        def measured(step: float, strip: Path) -> dict[str, Any]:
            def spoilt() -> Material:
                return axis.spoil(subject, step, axis.rng())

            return measure_training(method, spoilt, self.lpips, self.clock.now, strip)

        self._measure(axis, subject.name, method, measured)

    def _methods(self, axis: TrainingAxis, subject: Subject) -> list[Method]:
        effort = self.effort
        methods = [effort.refining if subject.filmed or axis.poses_off else effort.exact]
        if axis.believed_too and subject.name == PAINTED:
            methods.append(effort.believing)
        return methods

    def _fields(self, subject: Subject) -> None:
        if self.effort.axes == tuple(AXES):
            for axis in TRAINING_AXES:
                if axis.name in FIELD_AXES:
                    self._training(axis, subject, self.effort.of_a_field)

    def _meetings(self, subject: Subject) -> None:
        axes = self._axes(LIVE_AXES)
        model = self._model(subject) if axes else None
        for axis in axes:

            def measured(step: float, _: Path, axis: LiveAxis = axis) -> dict[str, Any]:
                assert model is not None
                body, size_px = subject.material.body, self.inputs.size_px
                return live.measure(axis, step, model, body, size_px, self.lpips)

            self._measure(axis, subject.name, self.effort.exact, measured, "live")

    def _model(self, subject: Subject) -> PerformerModel:
        """Of the undisturbed material, kept in a file."""
        path = self.writer.measurements / "model.safetensors"
        if not path.exists():
            model = train(
                subject.material.sequence(PoseTrust.EXACT),
                iterations=self.effort.iterations,
                clock=self.clock.now,
            )
            path.parent.mkdir(parents=True, exist_ok=True)
            save_model(model, path)
        return load_model(path)

    def _captures(self) -> None:
        axes = self._axes(CAPTURE_AXES)
        if not axes or self.inputs.motion is None or self.inputs.networks is None:
            return
        method = self.effort.refining
        with MediaPipeEstimator(self.inputs.networks[0]) as estimator:
            folder = self.inputs.folder / "footage"
            bench = CaptureBench(folder, estimator, method, self.lpips, self.clock)
            bench.render(self.inputs.motion)
            for axis in axes:

                def measured(step: float, strip: Path, axis: CaptureAxis = axis) -> dict[str, Any]:
                    return bench.measure(axis, step, strip)

                self._measure(axis, "captured", method, measured, "capture")

    def _measure(
        self,
        axis: Axis,
        subject: str,
        method: Method,
        measured: Callable[[float, Path], dict[str, Any]],
        kind: str = "training",
    ) -> None:
        """Every chosen step that was not measured yet; the undisturbed one is the same for all
        axes of a kind."""
        for step in axis.chosen(self.effort.steps):
            undisturbed = step == axis.steps[0]
            what = f"{kind} undisturbed" if undisturbed else f"{axis.name} {axis.label(step)}"
            name = f"{what}, {subject}, {method.name} {method.trust}".replace("/", "-")
            wanted = "" if undisturbed else self.only
            cache = self.writer.cache(wanted if self._may_begin() else _NOTHING)
            strip = cache.folder / "strips" / f"{name}.png"
            of = {
                "iterations": method.iterations,
                "size": self.inputs.size_px,
                "frames": self.inputs.frames,
                **self.clock.about(),
            }
            found = cache.measured(name, of, lambda s=step, p=strip: measured(s, p))
            if found is None:
                self.missing += 1
                continue
            self.rows.append(row_of(axis, step, subject, method.name, found))
            self.strips.append(strip)

    def report(self) -> dict[str, Any]:
        """What the file of figures holds."""
        return {
            "frames": self.inputs.frames,
            "size": self.inputs.size_px,
            "steps_of_an_axis": self.effort.steps,
            "missing": self.missing,
            "iterations": {
                "exact": self.effort.iterations,
                "refining": self.effort.refining_iterations,
                FIELD: self.effort.field_iterations,
            },
            "lpips": self.lpips.backbone,
            "region": "body crop",
            "breaks": {
                "lost_db": LOST_DB,
                "lost_lpips": LOST_LPIPS,
                "least_db": LEAST_DB,
                "most_lpips": MOST_LPIPS,
            },
            **self.clock.about(),
            "outcomes": dict(Counter(row["outcome"] for row in self.rows)),
            "rows": self.rows,
        }

    def worst(self) -> Iterator[WorstPicture]:
        """The worst pictures by LPIPS, one of each axis and subject."""
        judged = [
            (row, strip)
            for row, strip in zip(self.rows, self.strips, strict=True)
            if row["outcome"] == MEASURED
            and row["lpips"] is not None
            and row["step"] != AXES[row["axis"]].steps[0]
        ]
        shown: set[tuple[str, str]] = set()
        for row, strip in sorted(judged, key=lambda one: -one[0]["lpips"]):
            which = (row["axis"], row["subject"])
            if which in shown or not strip.exists():
                continue
            shown.add(which)
            words = (
                f"{AXES[row['axis']].words}: {row['label']}".replace("°", " deg"),
                f"{row['subject']}, {row['method']}: {row['psnr_worst_view']:.1f} dB",
            )
            yield WorstPicture(strip, words, row["lpips"])


def run(
    writer: FigureWriter,
    inputs: SubjectSources,
    effort: StabilityEffort,
    only: str = "",
    within_s: float = math.inf,
) -> dict[str, Any]:
    """Measure what was not measured yet, draw the sheet, and report.

    `within_s`: no measurement is begun later than so many seconds from now; what is then missing
    is counted.
    """
    bench = Bench(writer, inputs, effort, only, time.monotonic() + within_s)
    bench.measure_all()
    draw_sheet(writer.picture("worst.jpg"), list(bench.worst())[:_SHEET])
    figures = bench.report()
    writer.write(figures)
    return figures
