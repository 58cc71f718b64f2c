"""Where methods fail, as docs/stability.md shows it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table
from benchmarks.stability.breaking import BreakingPoint, breaking_points
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
            "The first step that was measured and is broken, and the first that is no use at all "
            "(*no use undisturbed*: with nothing wrong at all):",
            _breaking_points(figures),
            "### Every step",
            _legend(figures),
            _steps(figures),
            measured_at(figures),
        ]
    )


def paper_stability(figures: Figures) -> str:
    """What the paper's field and splats lose, disturbed alike."""
    by_step: dict[tuple[str, float], dict[str, Any]] = {}
    for row in figures["rows"]:
        by_step.setdefault((row["axis"], row["step"]), {})[row["method"]] = row
    rows = []
    for (name, step), by_method in by_step.items():
        axis = AXES[name]
        undisturbed = by_step[name, axis.steps[0]]
        told = [_paper_cell(by_method[m], undisturbed[m]) for m in ("paper", _SPLATS)]
        what = axis.words if step == axis.steps[0] else ""
        rows.append([what, axis.label(step), *(cell for pair in told for cell in pair)])
    exact, refining = figures["splats_iterations"]
    return "\n\n".join(
        [
            f"On one {figures['device']}: the paper's field after {figures['paper_iterations']:,} "
            f"steps of its schedule, which is shrunk to them, and splats after {exact:,} "
            f"({refining:,} where poses are off); {figures['frames']} frames of "
            f"{figures['size']} px of the painted performer; in brackets what it lost.",
            markdown_table(
                ["what", "step", "paper, dB", "LPIPS x1000", "splats, dB", "LPIPS x1000"], rows
            ),
            measured_at(figures),
        ]
    )


def _paper_cell(row: dict[str, Any], undisturbed: dict[str, Any]) -> tuple[str, str]:
    if row["outcome"] != MEASURED:
        return row["outcome"], ""
    lost = "" if row is undisturbed else f" ({undisturbed['psnr'] - row['psnr']:.1f})"
    return f"{row['psnr']:.1f}{lost}", f"{1e3 * row['lpips']:.0f}"


def finding(figures: Figures) -> str:
    """What holds throughout, and what is no use at the first step that was measured."""
    points = [p for p in breaking_points(AXES, figures["rows"]) if p.method == _SPLATS]
    names = list(dict.fromkeys(point.axis for point in points))
    whole = [
        AXES[name].words
        for name in names
        if all(point.broken.at is None for point in points if point.axis == name)
    ]
    lost = {
        name: {
            p.subject
            for p in points
            if p.axis == name and p.unusable.share == 0.0 and p.unusable.last
        }
        for name in names
    }
    useless = [
        f"{AXES[name].words} ({_loss(figures, name, who)})" for name, who in lost.items() if who
    ]
    return (
        f"Of {len(names)} axes {len(whole)} hold to their last step: {_listed(whole)}. At the "
        f"first step that was measured somebody is no use any more for: {_listed(useless)}."
    )


def _listed(words: list[str]) -> str:
    return "; ".join(words) or "none"


def _loss(figures: Figures, name: str, subjects: set[str]) -> str:
    """dB from undisturbed to the first step, over those of `subjects` that have both; who they are,
    where others were measured, too."""
    axis, by_step, others = AXES[name], {}, False
    for row in figures["rows"]:
        if (row["axis"], row["method"], row["outcome"]) == (name, _SPLATS, MEASURED):
            others |= row["subject"] not in subjects
            if row["subject"] in subjects:
                by_step.setdefault(row["step"], {})[row["subject"]] = row["psnr"]
    steps = sorted(by_step, key=axis.steps.index)[:2]
    both = set.intersection(*(set(by_step[step]) for step in steps)) if len(steps) == 2 else set()
    if not both:
        return "no picture"
    before, after = (float(np.mean([by_step[step][who] for who in both])) for step in steps)
    told = f"{axis.label(steps[1])}: {before:.1f} to {after:.1f} dB"
    return f"{', '.join(sorted(subjects))}; {told}" if others else told


def _outcomes(figures: Figures) -> str:
    told = figures["outcomes"]
    failed, refused = told.get("failed", 0), told.get("refused", 0)
    lines = [
        f"{sum(told.values()):,} measurements: {failed} failures (an exception, a NaN, an empty "
        f"picture; 0 are allowed), {refused} clear refusals, {figures['missing']} still missing."
    ]
    whys: dict[str, list[str]] = {}
    for row in figures["rows"]:
        if row["outcome"] != MEASURED and row["axis"] in AXES:
            who = row["subject"] + (f", {row['method']}" if row["method"] != _SPLATS else "")
            what = f"{AXES[row['axis']].words}, {row['label']} ({who})"
            whys.setdefault(row["why"], []).append(what)
    return "\n".join([*lines, *(f"- {'; '.join(what)}: *{why}*" for why, what in whys.items())])


def _breaking_points(figures: Figures) -> str:
    found = breaking_points(AXES, figures["rows"])
    heads = columns(found)
    points = {(point.axis, (point.subject, point.method)): point for point in found}
    rows = [
        [axis.words, *(_point(points.get((name, head))) for head in heads)]
        for name, axis in AXES.items()
        if any(of == name for of, _ in points)
    ]
    return markdown_table(["what", *(", ".join(head) for head in heads)], rows)


def _point(point: BreakingPoint | None) -> str:
    if point is None:
        return ""
    broken = point.broken.at or f"holds to {point.broken.last}"
    if point.unusable.last is None:
        return f"{broken}; no use undisturbed"
    return broken if point.unusable.at is None else f"{broken}; no use: {point.unusable.at}"


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
    heads = ["what", "who", "step", "PSNR", "LPIPS", "as given", "flicker", "joints", "no picture"]
    rows = [row for row in figures["rows"] if row["method"] == _SPLATS]
    told = []
    for name, axis in AXES.items():
        words = axis.words
        for subjects in _measured_alike(row for row in rows if row["axis"] == name):
            who = "; ".join(subjects)
            for step in axis.steps:
                mine = [row for row in rows if (row["axis"], row["step"]) == (name, step)
                        and row["subject"] in subjects]  # fmt: skip
                if mine:
                    told.append([words, who, axis.label(step), *_cells(mine), _rolled_back(mine)])
                    words = who = ""
    heads.append("rolled back")
    if not any(cells[-1] for cells in told):
        heads, told = heads[:-1], [cells[:-1] for cells in told]
    return markdown_table(heads, told)


def _measured_alike(rows: Iterable[dict[str, Any]]) -> list[list[str]]:
    """Subjects whose steps are the same, so that a mean over them is of the same people at each."""
    steps: dict[str, set[float]] = {}
    for row in rows:
        steps.setdefault(row["subject"], set()).add(row["step"])
    alike: dict[frozenset[float], list[str]] = {}
    for subject, theirs in steps.items():
        alike.setdefault(frozenset(theirs), []).append(subject)
    return list(alike.values())


def _rolled_back(rows: list[dict[str, Any]]) -> str:
    """How often trainings went back to their last good state, and what that cost them."""
    times, seconds = (sum(row.get(name, 0) for row in rows)
                      for name in ("rollbacks", "rollback_seconds"))  # fmt: skip
    return f"{times} times, {seconds:.1f} s" if times else ""


def _cells(rows: list[dict[str, Any]]) -> list[str]:
    good = [row for row in rows if row["outcome"] == MEASURED]
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
