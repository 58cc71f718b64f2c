"""Where methods fail, as docs/stability.md shows it."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table
from benchmarks.stability.charts import columns
from benchmarks.stability.judge import MEASURED
from benchmarks.stability.measure import AXES

_SPLATS = "splats"


def stability(figures: Figures) -> str:
    """How often nothing came of it, the breaking points, every step, and where it was measured."""
    return "\n\n".join(
        [
            _outcomes(figures),
            "### Breaking points",
            _breaking_points(figures),
            "### Every step",
            _legend(figures),
            _steps(figures),
            measured_at(figures),
        ]
    )


def finding(figures: Figures) -> str:
    """What breaks soonest in the mean over performers, and what it does."""
    held: dict[str, list[float]] = {}
    for point in figures["breaking_points"]:
        if point["method"] == _SPLATS:
            held.setdefault(point["axis"], []).append(point["held"])
    share = {name: float(np.mean(values)) for name, values in held.items()}
    whole = sum(value == 1.0 for value in share.values())
    soonest = sorted(share, key=lambda name: share[name])[:5]
    named = "; ".join(f"{AXES[name].words} ({_loss(figures, name)})" for name in soonest)
    return (
        f"Of {len(share)} axes {whole} hold to their last step with everybody. Soonest broken are, "
        f"with what their first measured step costs in the mean: {named}."
    )


def _loss(figures: Figures, name: str) -> str:
    """dB from undisturbed to the first step, over the subjects that have both."""
    axis, pairs = AXES[name], {}
    for row in figures["rows"]:
        if row["axis"] == name and row["method"] == _SPLATS and row["outcome"] == MEASURED:
            pairs.setdefault(row["step"], []).append(row["psnr"])
    steps = sorted(pairs, key=axis.steps.index)[:2]
    if len(steps) < 2:
        return "no picture"
    before, after = (float(np.mean(pairs[step])) for step in steps)
    return f"{axis.label(steps[1])}: {before:.1f} to {after:.1f} dB"


def _outcomes(figures: Figures) -> str:
    told = figures["outcomes"]
    failed, refused = told.get("failed", 0), told.get("refused", 0)
    lines = [
        f"{sum(told.values()):,} measurements: {failed} failures (an exception, a NaN, an empty "
        f"picture; 0 are allowed), {refused} clear refusals, {figures['missing']} still missing."
    ]
    whys = {row["why"] for row in figures["rows"] if row["outcome"] != MEASURED}
    return "\n".join([*lines, *(f"- {why}" for why in sorted(whys))])


def _breaking_points(figures: Figures) -> str:
    heads = columns(figures)
    points = {
        (point["axis"], (point["subject"], point["method"])): point
        for point in figures["breaking_points"]
    }
    rows = [
        [axis.words, *(_point(points.get((name, head))) for head in heads)]
        for name, axis in AXES.items()
        if any(of == name for of, _ in points)
    ]
    return markdown_table(["what", *(", ".join(head) for head in heads)], rows)


def _point(point: dict[str, Any] | None) -> str:
    if point is None:
        return ""
    if point["breaks_at"] is None:
        return f"{point['holds_to']}, the last"
    if point["holds_to"] is None:
        return "undisturbed already"
    useless = "; no use" if point["unusable_at"] == point["breaks_at"] else ""
    return f"{point['holds_to']} → {point['breaks_at']}{useless}"


def _legend(figures: Figures) -> str:
    steps = figures["iterations"]
    return (
        f"`splats`, {figures['frames']} frames of {figures['size']} px, {steps['exact']:,} steps "
        f"of training with exact poses, {steps['refining']:,} with poses that are off; PSNR in dB "
        f"(± standard deviation over performers) and LPIPS x1000 on `{figures['lpips']}` in the "
        f"{figures['region']}; as given: PSNR where test poses are not aligned; flicker as a "
        "multiple of the truth's own; joints in mm, as given and as training left them."
    )


def _steps(figures: Figures) -> str:
    rows = []
    for name, axis in AXES.items():
        for step in axis.steps:
            mine = [
                row
                for row in figures["rows"]
                if (row["axis"], row["step"], row["method"]) == (name, step, _SPLATS)
            ]
            good = [row for row in mine if row["outcome"] == MEASURED]
            if mine:
                first = step == axis.steps[0]
                rows.append([axis.words if first else "", axis.label(step), *_cells(good, mine)])
    return markdown_table(
        ["what", "step", "PSNR", "LPIPS", "as given", "flicker", "joints", "no picture"], rows
    )


def _cells(good: list[dict[str, Any]], rows: list[dict[str, Any]]) -> list[str]:
    none = f"{len(rows) - len(good)} of {len(rows)}" if len(good) < len(rows) else ""
    if not good:
        return ["", "", "", "", "", none]
    psnr = [row["psnr"] for row in good]
    spread = f" ± {np.std(psnr):.1f}" if len(psnr) > 1 else ""
    given, after = _mean(good, "joint_mm_given"), _mean(good, "joint_mm")
    captured = _mean(good, "joint_one_scale_mm")
    joints = "" if after is None else f"{after:.0f}"
    if captured is not None:
        joints = f"{captured:.0f}"
    if given is not None:
        joints = f"{given:.0f} → {joints}"
    return [
        f"{np.mean(psnr):.1f}{spread}",
        _number(good, "lpips", 1e3, 0),
        _number(good, "psnr_as_given", 1.0, 1),
        _number(good, "flicker", 1.0, 2),
        joints,
        none,
    ]


def _number(rows: list[dict[str, Any]], name: str, factor: float, digits: int) -> str:
    value = _mean(rows, name)
    return "" if value is None else f"{factor * value:.{digits}f}"


def _mean(rows: list[dict[str, Any]], name: str) -> float | None:
    known = [row[name] for row in rows if row.get(name) is not None]
    return float(np.mean(known)) if known else None
