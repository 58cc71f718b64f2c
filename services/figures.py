"""An evaluation as people read it: a table of means and spreads, and its contact sheet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from renderer.evaluation.contact_sheet import contact_sheet
from renderer.evaluation.evaluate import REGIONS, EvaluatedView
from services.video import write_png

_SHOWN = {"psnr": ("PSNR, dB", 1.0, 2), "ssim": ("SSIM", 1.0, 4), "lpips": ("LPIPS x1000", 1e3, 1)}
"""Measure: its name, what it is multiplied with, decimals."""
_INK = (235, 235, 235)


def print_figures(figures: dict[str, Any]) -> None:
    """Mean and spread over pictures, a row a split and region, and how they were measured."""
    table = Table(
        "views", "region", *(name for name, _, _ in _SHOWN.values()), box=None, padding=(0, 2, 0, 0)
    )
    for split, views in figures["per_view"].items():
        for region in REGIONS:
            shown = [_with_spread(figures, measure, split, region) for measure in _SHOWN]
            if any(shown):
                what = f"{split.replace('_', ' ')} ({len(views)})"
                table.add_row(what, region.replace("_", " "), *shown)
    console = Console()
    console.print(table)
    for line in _conditions(figures["conditions"]):
        console.print(line, highlight=False, soft_wrap=True)


def size_words(report: dict[str, Any] | None) -> list[str]:
    """What a training's metrics tell under `size`, for people; nothing of a model in full."""
    if not report:
        return []
    lines = [f"{report['kept']:,} of {report['of']:,} splats kept"]
    for rung in report.get("tried", ()):
        worse = ", ".join(_worse_words(rung))
        verdict = "kept" if rung["splats"] == report["kept"] else "too few"
        verdict = verdict if not rung["good"] or verdict == "kept" else "more than needed"
        lines.append(f"  {rung['splats']:,}: worse by {worse}; {verdict}")
    return lines


def _worse_words(rung: dict[str, Any]) -> list[str]:
    """By how much a number of splats was worse than all; models of earlier versions say less."""
    decibels = [f"{name} {db:+.2f} dB" for name, db in rung["lost_db"].items()]
    lpips = [
        f"{name} {now - of_all:+.4f} LPIPS" for name, (of_all, now) in rung.get("lpips", {}).items()
    ]
    apart = [f"{rung['apart']:.3f} LPIPS apart from beside"] if "apart" in rung else []
    return [*decibels, *lpips, *apart]


def _with_spread(figures: dict[str, Any], measure: str, split: str, region: str) -> str:
    mean, spread = figures[measure][split][region], figures["spread"][measure][split][region]
    _, factor, digits = _SHOWN[measure]
    return "" if mean is None else f"{factor * mean:.{digits}f} ± {factor * spread:.{digits}f}"


def _conditions(about: dict[str, Any]) -> list[str]:
    model, lpips = about["model"], about["lpips"]
    sizes = {f"{width} x {height}" for width, height in about["resolution"].values()}
    lines = [
        f"mean ± standard deviation over (so many) pictures of {', '.join(sorted(sizes))}; "
        f"black background, {about['colour']}; "
        f"one moment in {about['every']}; test poses {about['test_poses']}"
    ]
    if not about["trained_on_this_data"]:
        lines.append(
            "the model was trained on other data: these frames are new to it, in their own poses"
        )
    if lpips is not None:
        lines.append(f"LPIPS {lpips['linear_layers']} on {lpips['backbone']}, inputs in [-1, 1]")
    steps = f"{model['preset']}: {model.get('steps', '?')} steps"
    if "published_iterations" in model:
        steps += f" of the {model['published_iterations']} published, all schedules scaled alike"
    return [*lines, steps, *size_words(model.get("size"))]


def write_sheet(path: Path, views: list[EvaluatedView]) -> None:
    """The contact sheet of `views` with its captions, as PNG."""
    sheet, captions = contact_sheet(views)
    picture = np.ascontiguousarray((255.0 * sheet + 0.5).astype(np.uint8))
    for caption in captions:
        cv2.putText(
            picture,
            caption.text,
            (caption.x, caption.y),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.45,
            _INK,
            1,
            cv2.LINE_AA,
        )
    write_png(path, picture)
