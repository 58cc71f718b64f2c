"""The table of the README: five performers in real motion, three looks, `fast` and `splats`.

60 frames of 256 x 256 from one camera, exact poses, body crop. Each cell is stored as soon as it
is measured.
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
from capture.studio.sequence import LOOKS
from renderer.evaluation.evaluate import evaluate
from renderer.training import train

BUDGETS_S = {"fast": 90.0, "splats": 20.0}
FRAMES, SIZE = 60, 256
_MEASURES = ("psnr", "ssim", "lpips")


def run(
    writer: FigureWriter,
    motion: Path,
    backbone: Path | None,
    clock_name: str,
    only: str,
) -> None:
    """Measure what was not measured yet, and report."""
    cache, clock = writer.cache(only), clock_named(clock_name)
    lpips = None if backbone is None else backbone.name

    def measured(about: dict[str, Any]) -> list[dict[str, Any]]:
        about = {**about, **clock.about()}
        row = cache.measured(
            f"{about['look']}/{about['performer']}/{about['preset']}",
            {**about, "size": SIZE, "lpips": lpips},
            lambda: _cell(about, motion, backbone, clock),
        )
        return [] if row is None else [{**about, **row}]

    rows = []
    for look in LOOKS:
        for performer in NAMED_PERFORMERS:
            for preset, budget_s in BUDGETS_S.items():
                about = {"look": look, "performer": performer}
                rows += measured({**about, "preset": preset, "budget_s": budget_s})
    about = {
        "frames": FRAMES,
        "size": SIZE,
        "poses": "exact",
        "region": "body crop",
        **clock.about(),
    }
    writer.write({**about, "means": means(rows), "rows": rows})


def _cell(
    about: dict[str, Any], motion: Path, backbone: Path | None, clock: Clock
) -> dict[str, Any]:
    """One performer in one look, one preset trained and judged."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sequence"
        make_sequence(
            path,
            performer=about["performer"],
            motion=motion,
            look=about["look"],
            frames=FRAMES,
            size=SIZE,
        )
        clip = open_sequence(path)
        model = train(
            clip,
            preset=about["preset"],
            budget_s=about["budget_s"],
            find_light=True,
            clock=clock.now,
        )
        return figures_of(model, evaluate(model, clip, backbone))


def means(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Mean and standard deviation over the performers of each look and preset."""
    summaries = []
    for look, preset in dict.fromkeys((row["look"], row["preset"]) for row in rows):
        group = [row for row in rows if (row["look"], row["preset"]) == (look, preset)]
        mean: dict[str, Any] = {
            "look": look,
            "preset": preset,
            "budget_s": group[0]["budget_s"],
            "performers": len(group),
        }
        for measure in _MEASURES:
            for split in ("novel_view", "unseen_pose"):
                known = [row[f"{measure}_{split}_body_crop"] for row in group]
                known = [value for value in known if value is not None]
                mean[f"{measure}_{split}"] = round(float(np.mean(known)), 4) if known else None
                spread = round(float(np.std(known)), 4) if known else None
                mean[f"{measure}_{split}_spread"] = spread
        summaries.append(mean)
    return summaries
