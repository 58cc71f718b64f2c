"""The heat map of how far each axis holds, and a small curve of each axis."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.stability.breaking import BreakingPoint, Row, breaking_points, is_broken
from benchmarks.stability.judge import MEASURED
from benchmarks.stability.measure import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555", "#000000")
"""Okabe and Ito's, told apart by the colour-blind too."""
_COLUMNS = 6
_SHORT = {"splats, poses believed": "poses believed"}


def draw_charts(figures: dict[str, Any], folder: Path) -> None:
    """`stability.png` and `.svg`, the heat map; `stability-curves.png` and `.svg`."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update(
        {
            "font.size": 8,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "svg.hashsalt": "stability",
        }
    )
    from matplotlib import pyplot

    for name, chart in (("", _heat_map(figures)), ("-curves", _curves(figures))):
        for suffix in (".svg", ".png"):
            about = {"Date": None} if suffix == ".svg" else None
            chart.savefig(folder / f"stability{name}{suffix}", dpi=130, metadata=about)
        pyplot.close(chart)


def columns(points: list[BreakingPoint]) -> list[tuple[str, str]]:
    """Subject and method of each column, as they were measured, splats first."""
    found = dict.fromkeys((point.subject, point.method) for point in points)
    return sorted(found, key=lambda one: (one[1] != "splats", one[1]))


def _heat_map(figures: dict[str, Any]) -> Figure:
    import numpy as np
    from matplotlib import pyplot

    found = breaking_points(AXES, figures["rows"])
    points = {(point.axis, (point.subject, point.method)): point for point in found}
    names = [name for name in AXES if any(axis == name for axis, _ in points)]
    heads = columns(found)
    shares = np.full((len(names), 2 * len(heads)), np.nan)
    size = (3.2 + 1.7 * len(heads), 1.5 + 0.24 * len(names))
    chart, axes = pyplot.subplots(figsize=size, layout="constrained")
    for row, name in enumerate(names):
        for column, head in enumerate(heads):
            point = points.get((name, head))
            for half, reach in enumerate((point.broken, point.unusable) if point else ()):
                shares[row, 2 * column + half] = reach.share
                colour = "black" if 0.25 < reach.share < 0.75 else "white"
                axes.text(2 * column + half, row, _tick(reach.last or "never"), ha="center",
                          va="center", fontsize=6.5, color=colour)  # fmt: skip
    axes.imshow(shares, cmap="RdYlBu", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_yticks(range(len(names)), [AXES[name].words for name in names])
    axes.set_xticks(
        [2 * column + half for column in range(len(heads)) for half in (0, 1)],
        [
            "\n".join((*(_SHORT.get(word, word) for word in head), half))
            for head in heads
            for half in ("without loss", "of some use")
        ],
        fontsize=6.5,
    )
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    _lines_between_groups(axes, [AXES[name].group for name in names])
    for column in range(1, len(heads)):
        axes.axvline(2 * column - 0.5, color="white", linewidth=3.0)
    chart.suptitle("The last step that holds; blue: to the end, red: not even a little", fontsize=8)
    return chart


def _lines_between_groups(axes: Axes, groups: list[str]) -> None:
    for row in range(1, len(groups)):
        if groups[row] != groups[row - 1]:
            axes.axhline(row - 0.5, color="white", linewidth=3.0)


def _curves(figures: dict[str, Any]) -> Figure:
    from matplotlib import pyplot

    rows: list[Row] = figures["rows"]
    names = [name for name in AXES if any(row["axis"] == name for row in rows)]
    heads = columns(breaking_points(AXES, rows))
    count = -(-max(len(names), 1) // _COLUMNS)
    chart, panels = pyplot.subplots(
        count, _COLUMNS, figsize=(13.0, 0.6 + 1.75 * count), layout="constrained", squeeze=False
    )
    for panel in panels.flat[len(names) :]:
        panel.set_visible(False)
    for name, panel in zip(names, panels.flat, strict=False):
        for colour, head in zip(_COLOURS * 2, heads, strict=False):
            mine = [r for r in rows if (r["axis"], (r["subject"], r["method"])) == (name, head)]
            if mine:
                _curve(panel, name, mine, colour, head)
        panel.axhline(figures["breaks"]["least_db"], color="#bbbbbb", linewidth=0.7, zorder=0)
        panel.set_title(AXES[name].words, fontsize=7.5)
        panel.set_ylim(8.0, 42.0)
        panel.tick_params(labelsize=6)
    lines = {line.get_label(): line for panel in panels.flat for line in panel.get_lines()
             if not str(line.get_label()).startswith("_")}  # fmt: skip
    chart.legend(
        list(lines.values()), [str(label) for label in lines], loc="outside lower center", ncols=4,
        frameon=False, fontsize=7,
    )  # fmt: skip
    chart.suptitle(
        "PSNR of unseen views, dB (body crop); hollow: broken; grey: what is no use at all",
        fontsize=9,
    )
    return chart


def _curve(panel: Axes, name: str, rows: list[Row], colour: str, head: tuple[str, str]) -> None:
    axis = AXES[name]
    rows = sorted(rows, key=lambda row: axis.steps.index(row["step"]))
    drawn = [(axis.steps.index(r["step"]), r) for r in rows if r["outcome"] == MEASURED]
    label = ", ".join(head)
    panel.plot([at for at, _ in drawn], [r["psnr"] for _, r in drawn], color=colour, lw=1.0,
               label=label)  # fmt: skip
    for at, row in drawn:
        hollow = is_broken(axis, row, rows[0])
        panel.plot(at, row["psnr"], "o", ms=3.5, mec=colour, mfc="white" if hollow else colour)
    for row in rows:
        if row["outcome"] != MEASURED:
            panel.plot(axis.steps.index(row["step"]), 9.5, "x", ms=5.0, color=colour)
    # the unit once: many a label is as wide as its place
    numbers = [] if axis.labels else [f"{step:g}" for step in axis.steps[:-1]]
    rest = [_tick(axis.label(step)) for step in axis.steps[len(numbers) :]]
    panel.set_xticks(range(len(axis.steps)), numbers + rest)


def _tick(label: str) -> str:
    """Without words that the title has."""
    return label.split(" of ")[0].removesuffix(" x further")
