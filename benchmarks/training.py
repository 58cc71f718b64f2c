"""Accuracy on unseen views and poses against training time, on studio performers."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.report import write_report
from capture.store import open_sequence
from capture.studio import make_sequence
from renderer.evaluation import evaluate
from renderer.training import train
from scene.sequence import Sequence

RUNS = (("splats", (2, 5, 10, 20)), ("fast", (30, 90)))
"""Preset and budgets, s."""
PERFORMERS = (("plain", 0), ("lit", 0))


def run(json_file: Path | None, backbone: Path | None) -> None:
    """Measure, report, and draw the chart beside the JSON."""
    rows = []
    for look, seed in PERFORMERS:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "sequence"
            make_sequence(path, look=look, seed=seed)
            clip = open_sequence(path)
            for preset, budgets in RUNS:
                for budget_s in budgets:
                    rows.append({"look": look, **_row(clip, preset, budget_s, backbone)})
                    print(rows[-1], flush=True)
    about = {"frames": 60, "size": 256, "region": "body crop", "poses": "exact", "seed": 0}
    write_report(json_file, "training", {**about, "rows": rows})
    if json_file is not None:
        _draw(rows, json_file.with_suffix(".svg"))


def _row(clip: Sequence, preset: str, budget_s: float, backbone: Path | None) -> dict[str, Any]:
    model = train(clip, preset=preset, budget_s=budget_s, clock=time.perf_counter)
    figures = evaluate(model, clip, lpips_backbone=backbone)
    row: dict[str, Any] = {
        "preset": preset, "budget_s": budget_s, "steps": model.metrics["steps"]
    }  # fmt: skip
    for metric in ("psnr", "ssim", "lpips"):
        for split, regions in (figures.get(metric) or {}).items():
            row[f"{metric}_{split}"] = round(float(regions["body_crop"]), 4)
    return row


def _draw(rows: list[dict[str, Any]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4.2), layout="constrained")
    for look in dict.fromkeys(row["look"] for row in rows):
        for preset in dict.fromkeys(row["preset"] for row in rows):
            line = [r for r in rows if (r["look"], r["preset"]) == (look, preset)]
            times = [r["budget_s"] for r in line]
            axes.plot(times, [r["psnr_novel_view"] for r in line], "o-", label=f"{preset}, {look}")
    axes.set(xscale="log", xlabel="training time, s", ylabel="PSNR of unseen views, dB (body crop)")
    axes.grid(alpha=0.3)
    axes.legend()
    for suffix in (".svg", ".png"):
        figure.savefig(path.with_suffix(suffix), dpi=150)
