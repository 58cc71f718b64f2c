"""The frontier's three charts: speed against accuracy, accuracy against training, speed-ups."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.frontier.pareto import pareto_front

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACCURACY = "psnr_novel_view_body_crop"
SHORT = {
    "+cull+occupancy+early-stop+baked": " + all exact",
    "+cull": " + cull",
    "+occupancy": " + occupancy",
    "+early-stop": " + early stop",
    "+baked": " + baked",
    "+posed-grid": " + posed grid",
    "+grid": " + grid",
}
_COLOURS = {
    "splats": "#0072b2",
    "fast": "#d55e00",
    "paper+grid": "#cc79a7",
    "paper": "#009e73",
    "humannerf": "#555555",
}
"""Of each family (Okabe and Ito's, told apart by the colour-blind too)."""
_PLACES = ((8, 6), (8, -20), (-8, 6), (-8, -20), (8, 20), (-8, 20), (8, -34), (-8, -34),
           (24, 34), (-24, 34))  # fmt: skip
"""Where a label may stand beside its point, pt, in order of preference."""

_LEADER = {"arrowstyle": "-", "lw": 0.4, "color": "#999999"}


def draw_charts(figures: dict[str, Any], points: list[dict[str, Any]], json_file: Path) -> None:
    """`NAME.svg` and `.png` beside the JSON, and the same with `-training` and `-steps`.

    What `bench distil` left there, of the same performer, joins the chart of training.
    """
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update(
        {
            "font.size": 9,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "svg.hashsalt": "frontier",
        }
    )
    stem = json_file.with_suffix("")
    for name, chart in (
        ("", _frontier(figures, points)),
        ("-training", _training(figures, json_file.with_name("distil.json"))),
        ("-steps", _steps(figures)),
    ):
        for suffix in (".svg", ".png"):
            about = {"Date": None} if suffix == ".svg" else None
            chart.savefig(f"{stem}{name}{suffix}", dpi=150, metadata=about)


def short_name(preset: str) -> str:
    """`preset` as a chart has room for it."""
    if preset.startswith("paper+grid"):
        return "paper + grid"
    for suffix, words in SHORT.items():
        if preset.endswith(suffix):
            return preset.removesuffix(suffix) + words
    return preset


def family(preset: str) -> str:
    """What gives a preset its colour."""
    return "paper+grid" if preset.startswith("paper+grid") else preset.split("+")[0]


def counted(number: float) -> str:
    """1234567 as 1.23 M."""
    return f"{number / 1e6:.2f} M" if number < 1e7 else f"{number / 1e6:.1f} M"


def _conditions(figures: dict[str, Any]) -> str:
    if figures["clock"] == "processor":
        return "one CPU thread, its own time"
    return f"{figures['threads']} CPU cores, wall clock"


def _frontier(figures: dict[str, Any], points: list[dict[str, Any]]) -> Figure:
    from matplotlib import pyplot

    chart, panels = pyplot.subplots(1, 2, figsize=(11, 4.8), layout="constrained", sharey=True)
    for axes, size in zip(panels, ("512", "1024"), strict=True):
        shown = [p for p in points if p.get(ACCURACY) is not None]
        places = [(p[size]["p50_ms"], p[ACCURACY]) for p in shown]
        front = [places[i] for i in pareto_front(places)]
        if front:
            front.append((max(ms for ms, _ in places), front[-1][1]))  # what lies below is beaten
            axes.step(*zip(*front, strict=True), where="post", color="#bbbbbb", lw=1.2, zorder=1)
        for point, (ms, decibels) in zip(shown, places, strict=True):
            hollow = "white" if point["scaled"] else _COLOURS[family(point["preset"])]
            axes.plot(
                ms, decibels, "o", ms=7, mec=_COLOURS[family(point["preset"])], mfc=hollow, mew=1.5
            )
        axes.axvline(1000.0 / 30.0, color="#bbbbbb", lw=0.8, ls=":")
        axes.set(xscale="log", xlabel=f"ms a frame at {size} x {size}, p50", title=f"{size} px")
        axes.margins(x=0.18, y=0.18)
        axes.grid(alpha=0.25, which="major")
        _label(chart, axes, [(xy, _words(p, size)) for p, xy in zip(shown, places, strict=True)])
        axes.annotate(
            " 30 frames/s",
            (1000.0 / 30.0, 0.0),
            xycoords=("data", "axes fraction"),
            fontsize=7,
            va="bottom",
            color="#888888",
        )
    panels[0].set_ylabel("PSNR of unseen views, dB (body crop)")
    chart.suptitle(
        f"Speed against accuracy: {_conditions(figures)}; "
        "hollow: a scaled training run; * time estimated from a smaller frame",
        fontsize=9,
    )
    return chart


def _words(point: dict[str, Any], size: str) -> str:
    star = "" if str(point[size]["measured_px"]) == size else " *"
    return (
        f"{short_name(point['preset'])}{star}\n"
        f"{counted(point['parameters'])}, {point['megabytes']:.3g} MB"
    )


def _label(chart: Figure, axes: Axes, labels: list[tuple[tuple[float, float], str]]) -> None:
    """Words beside their points, each at the first place where they cover nothing."""
    chart.draw_without_rendering()
    renderer = chart.canvas.get_renderer()  # pyright: ignore[reportAttributeAccessIssue]
    radius = 6.0
    taken = []
    for (x, y), _ in labels:
        across, up = axes.transData.transform((x, y))
        taken.append((across - radius, up - radius, across + radius, up + radius))
    frame = axes.get_window_extent(renderer)
    for (x, y), words in labels:
        for place, offset in enumerate(_PLACES):
            text = axes.annotate(
                words,
                (x, y),
                xytext=offset,
                textcoords="offset points",
                fontsize=7,
                ha="left" if offset[0] > 0 else "right",
                arrowprops=_LEADER if place > 3 else None,
            )
            box = text.get_window_extent(renderer)
            inside = box.x0 > frame.x0 and box.x1 < frame.x1 and box.y1 < frame.y1 + 20.0
            if (inside and not any(_meet(box.extents, other) for other in taken)) or (
                place == len(_PLACES) - 1
            ):
                taken.append(box.extents)
                break
            text.remove()


def _meet(one: Any, other: Any) -> bool:
    return bool(one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3])


def _training(figures: dict[str, Any], distilled: Path) -> Figure:
    from matplotlib import pyplot

    chart, axes = pyplot.subplots(figsize=(7, 4.2), layout="constrained")
    rows = [row for row in figures["accuracy"] if row.get(ACCURACY) is not None]
    for name in dict.fromkeys(row["preset"] for row in rows):
        line = [row for row in rows if row["preset"] == name]
        scaled = line[0].get("scaled") is not None
        axes.plot(
            [row["budget_s"] for row in line],
            [row[ACCURACY] for row in line],
            "o-",
            color=_COLOURS[family(name)],
            mfc="white" if scaled else None,
            mew=1.5,
            label=short_name(name) + (f" (scaled: {line[0]['steps']} steps)" if scaled else ""),
        )
    if distilled.is_file():
        point = _distilled(json.loads(distilled.read_text())["psnr"])
        axes.plot(*point, "^", color=_COLOURS["splats"], label="splats, distilled from fast")
    axes.set(
        xscale="log",
        xlabel=f"training, s ({_conditions(figures)}; scaled runs: one thread)",
        ylabel="PSNR of unseen views, dB (body crop)",
    )
    axes.xaxis.set_major_formatter("{x:g}")
    axes.grid(alpha=0.25)
    if rows:
        axes.legend(frameon=False, fontsize=8)
    return chart


def _distilled(psnr: dict[str, dict[str, float]]) -> tuple[float, float]:
    """Seconds of a field's training and of the splats' that learn from it, and their accuracy."""
    seconds = {name: float(name.split(", ")[-1].removesuffix(" s")) for name in psnr}
    field = next(name for name in psnr if name.startswith("fast"))
    splats = next(name for name in psnr if "distilled" in name)
    return seconds[field] + seconds[splats], psnr[splats]["novel_view"]


def _steps(figures: dict[str, Any]) -> Figure:
    from matplotlib import pyplot

    rows = figures["steps"][::-1]
    chart, axes = pyplot.subplots(
        figsize=(7.5, 0.6 + 0.3 * max(len(rows), 1)), layout="constrained"
    )
    times = [row["512"]["p50_ms"] for row in rows]
    names = [row["preset"] for row in rows]
    axes.barh(range(len(rows)), times, color=[_COLOURS[family(name)] for name in names], height=0.7)
    slow = {row["preset"]: row["512"]["p50_ms"] for row in rows if "+" not in row["preset"]}
    for place, row in enumerate(rows):
        star = "" if row["512"]["measured_px"] == 512 else " *"
        axes.annotate(
            f" {times[place]:,.0f} ms{star}{_against(row, slow)}",
            (times[place], place),
            va="center",
            fontsize=7,
        )
    axes.set_yticks(range(len(rows)), [short_name(name) for name in names])
    axes.set(
        xscale="log",
        xlabel="ms a frame at 512 x 512, p50, same weights (* estimated from a smaller frame)",
    )
    axes.margins(x=0.3)
    return chart


def _against(row: dict[str, Any], slow: dict[str, float]) -> str:
    """How much faster than without speed-ups, and what it costs."""
    base = row["preset"].split("+")[0]
    if row["preset"] == base or base not in slow:
        return ""
    cost = "same picture" if row["db_to_slow"] >= 50.0 else f"{row['db_to_slow']:.0f} dB to slow"
    return f"   {slow[base] / row['512']['p50_ms']:.1f} x, {cost}"
