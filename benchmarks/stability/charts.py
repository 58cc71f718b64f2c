"""The heat map of how far each axis holds, and a small curve of each axis."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.stability.breaking import Row, is_broken
from benchmarks.stability.judge import MEASURED
from benchmarks.stability.measure import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555")
"""Okabe and Ito's, told apart by the colour-blind too."""
_COLUMNS = 6
_SHORT = {"splats, poses believed": "poses believed", "splats": "splats"}


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


def columns(figures: dict[str, Any]) -> list[tuple[str, str]]:
    """Subject and method of each column, as they were measured."""
    found = ((point["subject"], point["method"]) for point in figures["breaking_points"])
    return sorted(dict.fromkeys(found), key=lambda one: (one[1] != "splats", one[1]))


def _heat_map(figures: dict[str, Any]) -> Figure:
    import numpy as np
    from matplotlib import pyplot

    points = {
        (point["axis"], (point["subject"], point["method"])): point
        for point in figures["breaking_points"]
    }
    names = [name for name in AXES if any(axis == name for axis, _ in points)]
    heads = columns(figures)
    held = np.full((len(names), len(heads)), np.nan)
    size = (2.6 + 1.05 * len(heads), 1.2 + 0.235 * len(names))
    chart, axes = pyplot.subplots(figsize=size, layout="constrained")
    for row, name in enumerate(names):
        for column, head in enumerate(heads):
            point = points.get((name, head))
            if point is None:
                continue
            held[row, column] = point["held"]
            words = "never" if point["holds_to"] is None else point["holds_to"]
            middle = 0.25 < point["held"] < 0.75
            axes.text(column, row, words, ha="center", va="center", fontsize=6.5,
                      color="black" if middle else "white")  # fmt: skip
    axes.imshow(held, cmap="RdYlBu", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_yticks(range(len(names)), [AXES[name].words for name in names])
    axes.set_xticks(
        range(len(heads)),
        [f"{subject}\n{_SHORT.get(method, method)}" for subject, method in heads],
    )
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    _lines_between_groups(axes, [AXES[name].group for name in names])
    axes.set_xlabel(
        "the last step that holds; blue: the axis' whole way, red: not even a little", fontsize=7
    )
    return chart


def _lines_between_groups(axes: Axes, groups: list[str]) -> None:
    for row in range(1, len(groups)):
        if groups[row] != groups[row - 1]:
            axes.axhline(row - 0.5, color="white", linewidth=3.0)


def _curves(figures: dict[str, Any]) -> Figure:
    from matplotlib import pyplot

    rows: list[Row] = figures["rows"]
    names = [name for name in AXES if any(row["axis"] == name for row in rows)]
    heads = columns(figures)
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
    panel.set_xticks(range(len(axis.steps)), [_tick(axis.label(step)) for step in axis.steps])


def _tick(label: str) -> str:
    """Without words that the title has."""
    return label.split(" of ")[0].removesuffix(" x further")
