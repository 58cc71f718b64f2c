"""Speed against accuracy: every preset on one sequence, in a run that can be cut and gone on with.

Three kinds of measurement, each stored as soon as it is made: `accuracy/PRESET@SECONDS`,
`speed/PRESET` of a trained model, and `steps/PRESET` of the paper's presets and their speed-ups
with the same weights.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.frontier.speed import STEPS, drawing, timed, timed_steps, weights_of
from benchmarks.frontier.training import RUNS, SCALED, accuracy, trained
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.measurements import MeasurementCache
from benchmarks.reporting.timing import Clock, clock_named
from capture.storage import open_sequence
from capture.studio import make_sequence
from renderer.presets import EXACT
from scene.sequence import Sequence

FRAMES, SIZE = 60, 256
"""Of the studio's first performer in the plain look, poses exact."""


def run(
    writer: FigureWriter, backbone: Path | None, scaled_s: float, clock_name: str, only: str
) -> None:
    """Measure what was not measured yet, and report."""
    state, cache, clock = writer.measurements, writer.cache(only), clock_named(clock_name)
    clip = _sequence(state)
    figures = {
        "sequence": {
            "performer": "studio, seed 0",
            "look": "plain",
            "poses": "exact",
            "frames": FRAMES,
            "size": SIZE,
            "data_hash": clip.data_hash,
        },
        **clock.about(),
        "accuracy": _accuracies(clip, cache, state, backbone, scaled_s, clock),
        "speed": _speeds(clip, cache, state, backbone, clock),
        "steps": _steps(clip, cache, clock),
    }
    writer.write({**figures, "points": points(figures)})


def _sequence(state: Path) -> Sequence:
    folder = state / "sequence"
    if not folder.exists():
        make_sequence(folder, frames=FRAMES, size=SIZE)
    return open_sequence(folder)


def _accuracies(
    clip: Sequence,
    cache: MeasurementCache,
    state: Path,
    backbone: Path | None,
    scaled_s: float,
    clock: Clock,
) -> list[dict[str, Any]]:
    """Every preset at every budget; the paper's own in scaled runs, on a thread's own time."""
    rows = []
    runs = [(name, budget, clock) for name, budgets in RUNS.items() for budget in budgets]
    runs += [(name, scaled_s, clock_named("processor")) for name in SCALED]
    for name, budget_s, counted in runs:
        clock_named(counted.name)
        about = {"preset": name, "budget_s": budget_s, **counted.about()}
        of = {**about, "data": clip.data_hash, "lpips": None if backbone is None else backbone.name}
        if name in SCALED:
            of["scale"] = [SCALED[name].patches, SCALED[name].samples]
        row = cache.measured(
            f"accuracy/{name}@{budget_s:g}",
            of,
            lambda n=name, b=budget_s, c=counted: accuracy(clip, n, b, state, backbone, c),
        )
        rows += [] if row is None else [{**about, **row}]
    clock_named(clock.name)
    return rows


def _speeds(
    clip: Sequence, cache: MeasurementCache, state: Path, backbone: Path | None, clock: Clock
) -> list[dict[str, Any]]:
    """Times of what trains on a CPU, by the models of the longest budgets."""
    rows = []
    for name, budgets in RUNS.items():

        def measure(name: str = name, budget_s: float = budgets[-1]) -> dict[str, Any]:
            model, _ = trained(clip, name, budget_s, state, backbone, clock)
            return {**timed(clip, drawing(model), clock), **weights_of(name)}

        of = {"preset": name, "data": clip.data_hash, **clock.about()}
        row = cache.measured(f"speed/{name}", of, measure)
        rows += [] if row is None else [{"preset": name, **row}]
    return rows


def _steps(clip: Sequence, cache: MeasurementCache, clock: Clock) -> list[dict[str, Any]]:
    fields: dict[str, Any] = {}
    rows = []
    for name in STEPS:
        of = {"preset": name, "data": clip.data_hash, **clock.about()}
        row = cache.measured(
            f"steps/{name}", of, lambda n=name: timed_steps(clip, n, clock, fields)
        )
        rows += [] if row is None else [{"preset": name, **row}]
    return rows


def points(figures: dict[str, Any]) -> list[dict[str, Any]]:
    """What the frontier shows: a time and the accuracy that belongs to it, a point a preset.

    The accuracy is that of the longest budget measured; for the paper's two presets, slow and with
    all exact speed-ups, that of their scaled run.
    """
    times = {row["preset"]: row for row in (*figures["speed"], *figures["steps"])}
    best = {row["preset"]: row for row in sorted(figures["accuracy"], key=lambda r: r["budget_s"])}
    made = []
    for name, row in best.items():
        drawn = (name, "+".join((name, *EXACT))) if name in SCALED else (name,)
        for step in drawn:
            if step in times:
                made.append({**row, **times[step], "preset": step, "scaled": row.get("scaled")})
    return made
