"""How soon a model is good: accuracy against training time, from nothing and from an earlier model.

Studio performers in recorded motion, 60 frames of 256 x 256 from one camera, exact poses. "Warm"
goes on from a model of the same person that was trained on another clip, in another motion.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.frontier.training import figures_of
from benchmarks.reporting.figures import FigureWriter
from benchmarks.reporting.timing import Clock, clock_named
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.named_performers import NAMED_PERFORMERS
from renderer.evaluation.evaluate import evaluate
from renderer.performer_model import PerformerModel
from renderer.training import train
from scene.sequence import Sequence

PERFORMERS = tuple(NAMED_PERFORMERS)[:3]
FRAMES, SIZE = 60, 256
EARLIER_S = 20.0
"""Training of the earlier model."""
BUDGETS_S = {
    "cold": (1.0, 2.0, 3.0, 5.0, 10.0, 15.0, 20.0, 30.0, 60.0, 90.0, 180.0),
    "warm": (0.5, 1.0, 2.0, 3.0, 5.0, 10.0),
}
GOOD_DB = 33.0
_ACCURACY = "psnr_novel_view_body_crop"


def run(
    writer: FigureWriter, motion: Path, backbone: Path | None, clock_name: str, only: str
) -> None:
    """Measure what was not measured yet, and report."""
    cache, clock = writer.cache(only), clock_named(clock_name)
    lpips = None if backbone is None else backbone.name
    motions = sorted(motion.glob("*.bvh"))
    rows: list[dict[str, Any]] = []
    for performer in PERFORMERS:
        about = {"performer": performer, "clip": motions[-1].stem, "earlier": motions[0].stem}
        found = cache.measured(
            performer,
            {**about, "budgets": BUDGETS_S, "lpips": lpips, **clock.about()},
            lambda p=performer: {"rows": _rows(p, motions[-1], motions[0], backbone, clock)},
        )
        rows += [] if found is None else [{**about, **row} for row in found["rows"]]
    curves = {start: curve(rows, start) for start in BUDGETS_S}
    good = {f"{start}_s": seconds_to(points, GOOD_DB) for start, points in curves.items()}
    about = {
        "frames": FRAMES,
        "size": SIZE,
        "poses": "exact",
        "region": "body crop",
        "earlier_s": EARLIER_S,
        **clock.about(),
    }
    figures = {**about, f"time_to_{GOOD_DB:g}_db": good, "curves": curves, "rows": rows}
    writer.write(figures)


def _rows(
    performer: str, motion: Path, other: Path, backbone: Path | None, clock: Clock
) -> list[dict[str, Any]]:
    """Every budget of one performer, from nothing and from a model of the other clip."""

    def trained(clip: Sequence, budget_s: float, start: PerformerModel | None) -> PerformerModel:
        return train(clip, preset="splats", budget_s=budget_s, start=start, clock=clock.now)

    with tempfile.TemporaryDirectory() as folder:
        clips = {}
        for name, moves in (("clip", motion), ("earlier", other)):
            path = Path(folder) / name
            make_sequence(path, performer=performer, motion=moves, frames=FRAMES, size=SIZE)
            clips[name] = open_sequence(path)
        earlier = trained(clips["earlier"], EARLIER_S, None)
        rows = []
        for start, budgets in BUDGETS_S.items():
            for budget_s in budgets:
                model = trained(clips["clip"], budget_s, earlier if start == "warm" else None)
                figures = figures_of(model, evaluate(model, clips["clip"], backbone))
                rows.append({"start": start, "budget_s": budget_s, **figures})
        return rows


def curve(rows: list[dict[str, Any]], start: str) -> list[tuple[float, float]]:
    """Budget, s, and the performers' mean PSNR in new views, dB, where all were measured."""
    points = []
    for budget_s in BUDGETS_S[start]:
        mine = [r for r in rows if (r["start"], r["budget_s"]) == (start, budget_s)]
        if mine:
            points.append((budget_s, round(float(np.mean([r[_ACCURACY] for r in mine])), 3)))
    return points


def seconds_to(points: list[tuple[float, float]], good_db: float) -> float | None:
    """The least time whose accuracy is `good_db`, linear between budgets; None: never."""
    before: tuple[float, float] | None = None
    for budget_s, accuracy in points:
        if accuracy >= good_db:
            if before is None:
                return budget_s
            share = (good_db - before[1]) / (accuracy - before[1])
            return round(before[0] + share * (budget_s - before[0]), 2)
        before = (budget_s, accuracy)
    return None


def draw_chart(figures: dict[str, Any], path: Path) -> None:
    """The curves of a report, as PNG."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.0, 3.4), layout="constrained")
    words = {"cold": "from nothing", "warm": "from the person's earlier model, another clip"}
    for (start, points), colour in zip(
        figures["curves"].items(), ("#0072b2", "#d55e00"), strict=True
    ):
        axes.plot(*zip(*points, strict=True), "o-", color=colour, label=words[start])
    axes.axhline(GOOD_DB, color="#999999", linewidth=0.8)
    axes.set(xscale="log", xlabel="training, s of one thread", ylabel="PSNR in new views, dB")
    axes.set_xticks([0.5, 1, 3, 10, 30, 100], labels=["0.5", "1", "3", "10", "30", "100"])
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)
