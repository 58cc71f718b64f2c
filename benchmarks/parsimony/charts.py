"""The chart of docs/parsimony.md: what a megabyte buys, and where `--size auto` ends."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

_COLOURS = ("#0072b2", "#56b4e9", "#009e73", "#d55e00", "#cc79a7", "#e69f00")
"""Okabe and Ito's, told apart by the colour-blind too."""
_PANELS = (
    ("body_psnr", "PSNR of the body, dB"),
    ("body_lpips", "LPIPS of the body"),
    ("face_lpips", "LPIPS of the face"),
)


def draw_parsimony(figures: dict[str, Any], path: Path) -> None:
    """`path`, a .png, and the .svg beside it: accuracy against the megabytes that a page fetches, a
    line a subject."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "parsimony"
    from matplotlib import pyplot
    from matplotlib.ticker import LogLocator, NullFormatter

    figure, panels = pyplot.subplots(1, 3, figsize=(11, 3.8), layout="constrained")
    for axes, (measure, words) in zip(panels, _PANELS, strict=True):
        for subject, colour in zip(figures["subjects"], cycle(_COLOURS), strict=False):
            line = _points(figures["rows"], subject["name"], "number", None, measure)
            if not line:
                continue  # a performer without a face that is judged
            axes.plot(*zip(*line, strict=True), ".-", color=colour, label=subject["name"], lw=1)
            for name, mark in (("full", "s"), ("auto", "o")):
                points = _points(figures["rows"], subject["name"], "size", name, measure)
                if points:
                    axes.plot(*np.mean(points, axis=0), mark, color=colour, ms=7, mec="black")
        axes.set(xscale="log", xlabel="MB that a page fetches", ylabel=words)
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    panels[-1].legend(*panels[0].get_legend_handles_labels(), frameon=False, fontsize=8)
    figure.suptitle("Square: all splats; circle: as few as the clip shows a need for", fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)
    figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
    pyplot.close(figure)


def _points(
    rows: list[dict[str, Any]], subject: str, group: str, name: str | None, measure: str
) -> list[tuple[float, float]]:
    """Megabytes and `measure` of the rows of a group, none where that was not measured."""
    chosen = [
        row
        for row in rows
        if (row["subject"], row["group"]) == (subject, group) and name in (None, row["name"])
    ]
    known = [(row["viewer_megabytes"], row[measure]) for row in chosen if row.get(measure)]
    return sorted(known) if name is None else known
