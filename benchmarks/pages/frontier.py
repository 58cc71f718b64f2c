"""The frontier's figures as Markdown."""

from __future__ import annotations

from typing import Any

from benchmarks.frontier.charts import ACCURACY, counted, short_name
from benchmarks.frontier.pareto import pareto_front
from benchmarks.frontier.speed import BASES, SIZES
from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table
from renderer.presets import EXACT

_CHARTS = (
    ("", "Milliseconds a frame against PSNR of unseen views"),
    ("-training", "PSNR of unseen views against training time"),
    ("-steps", "What each speed-up is worth"),
)


def frontier(figures: Figures) -> str:
    """All charts and tables, and where they were measured."""
    return f"{page(figures, figures['points'])}\n\n{measured_at(figures)}"


def page(figures: dict[str, Any], points: list[dict[str, Any]]) -> str:
    """All charts and tables, under what they were measured with."""
    lpips = next((row["conditions"]["lpips"] for row in figures["accuracy"]), None)
    backbone = "not measured" if lpips is None else f"x1000, {lpips['backbone']} backbone"
    counted_as = (
        "seconds of one thread's own time"
        if figures["clock"] == "processor"
        else (f"wall clock, {figures['threads']} cores")
    )
    parts = [
        f"Times: {counted_as}. PSNR, SSIM and LPIPS ({backbone}, inputs in [-1, 1]): body crop, "
        "black background, 256 x 256, unseen views / unseen poses.",
        *(f"![{words}](figures/frontier{part}.png)" for part, words in _CHARTS),
        "### The frontier",
        _frontier(points),
        "`*` estimated: a smaller frame was timed and its time multiplied with the ratio of the "
        "pixels. **Bold**: on the Pareto front at 512 x 512.",
        *_scaled(figures),
        "### Accuracy against training time",
        _training(figures),
        "### The paper's presets and each speed-up, same weights",
        _steps(figures),
        _ratios(figures),
    ]
    return "\n\n".join(part for part in parts if part)


def _frontier(points: list[dict[str, Any]]) -> str:
    known = [point for point in points if point.get(ACCURACY) is not None]
    front = pareto_front([(p["512"]["p50_ms"], p[ACCURACY]) for p in known])
    rows = []
    for index, point in enumerate(known):
        name = short_name(point["preset"])
        rows.append(
            [
                f"**{name}**" if index in front else name,
                *(_milliseconds(point[str(size)], size) for size in SIZES),
                *_accuracy(point),
                _trained(point),
                counted(point["parameters"]),
                f"{point['megabytes']:.3g}",
            ]
        )
    head = [
        "preset",
        *(f"ms at {size}, p50 (p95)" for size in SIZES),
        "PSNR, dB",
        "SSIM",
        "LPIPS",
        "training",
        "parameters",
        "MB",
    ]
    return markdown_table(head, rows)


def _scaled(figures: dict[str, Any]) -> list[str]:
    """What was cut down in each scaled run."""
    return [
        f"`{row['preset']}` is a **scaled run**: {row['scaled']['patches']} patches of 20 x 20 px "
        f"a step (published: 6), {row['scaled']['samples']} samples a ray (128), {row['steps']:,} "
        f"steps ({row['published_iterations']:,}) in {row['train_seconds']:.0f} s of one thread, "
        "all schedules scaled alike. It says how far the method comes in that time, not where it "
        "ends."
        for row in figures["accuracy"]
        if row.get("scaled")
    ]


def _training(figures: dict[str, Any]) -> str:
    rows = [
        [
            short_name(row["preset"]),
            _trained(row),
            f"{row['steps']:,}",
            *_accuracy(row),
            f"{row['file_megabytes']:.3g}",
        ]
        for row in figures["accuracy"]
    ]
    head = ["preset", "training", "steps", "PSNR, dB", "SSIM", "LPIPS", "MB of the file"]
    return markdown_table(head, rows)


def _steps(figures: dict[str, Any]) -> str:
    times = {row["preset"]: row for row in figures["steps"]}
    rows = []
    for name, row in times.items():
        slow = times.get(name.split("+")[0], row)
        faster = [slow[str(size)]["p50_ms"] / row[str(size)]["p50_ms"] for size in SIZES]
        rows.append(
            [
                short_name(name),
                *(_milliseconds(row[str(size)], size) for size in SIZES),
                " / ".join(f"{ratio:.1f}" for ratio in faster),
                "" if "+" not in name else f"{row['db_to_slow']:.0f}",
                counted(row["parameters"]),
                f"{row['megabytes']:.3g}",
            ]
        )
    head = [
        "preset",
        *(f"ms at {size}, p50 (p95)" for size in SIZES),
        "times faster",
        "dB to slow",
        "parameters",
        "MB",
    ]
    return markdown_table(head, rows)


def _ratios(figures: dict[str, Any]) -> str:
    """`paper` against `humannerf`, as the paper compares itself, plain and with what is exact."""
    times = {row["preset"]: row for row in figures["steps"]}
    told = []
    for suffix, words in (("", "as they are"), ("+" + "+".join(EXACT), "with all exact speed-ups")):
        both = [times.get(base + suffix) for base in BASES]
        if all(both):
            slow, quick = both
            ratios = [slow[str(s)]["p50_ms"] / quick[str(s)]["p50_ms"] for s in SIZES]  # pyright: ignore[reportOptionalSubscript]
            told.append(f"{' / '.join(f'{ratio:.1f}' for ratio in ratios)} {words}")
    if not told:
        return ""
    return (
        f"`paper` is faster than `humannerf` by these factors at 512 / 1024: {', '.join(told)} "
        "(the paper on its GPU at 1024: 3.1)."
    )


def _milliseconds(row: dict[str, Any], size: int) -> str:
    star = "" if row["measured_px"] == size else " *"
    return f"{_short(row['p50_ms'])} ({_short(row['p95_ms'])}){star}"


def _short(ms: float) -> str:
    return f"{ms:.1f}" if ms < 100.0 else f"{ms:,.0f}"


def _trained(row: dict[str, Any]) -> str:
    return f"{row['budget_s']:g} s{' (scaled)' if row.get('scaled') else ''}"


def _accuracy(row: dict[str, Any]) -> list[str]:
    """PSNR, SSIM and LPIPS of unseen views / unseen poses."""
    told = []
    for measure, factor, digits in (("psnr", 1.0, 1), ("ssim", 1.0, 3), ("lpips", 1e3, 1)):
        pair = [row[f"{measure}_{split}_body_crop"] for split in ("novel_view", "unseen_pose")]
        told.append(" / ".join("-" if v is None else f"{factor * v:.{digits}f}" for v in pair))
    return told
