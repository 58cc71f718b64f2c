"""Where an axis breaks: pictures are plainly worse than undisturbed, or no use at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.reporting.origin import ORIGIN
from benchmarks.stability.axis import Axis
from benchmarks.stability.judge import MEASURED

LOST_DB, LOST_LPIPS = 3.0, 0.5
"""Lost against the undisturbed step: dB, and the share by which LPIPS grows."""
LEAST_DB, MOST_LPIPS = 24.0, 0.25
"""Below or above, a picture is no use, whatever it was before."""

Row = dict[str, Any]
"""One measurement: its axis, subject, method and step, the outcome and figures."""


def row_of(axis: Axis, step: float, subject: str, method: str, found: dict[str, Any]) -> Row:
    """What was `found` there, without where it was measured."""
    about = {"axis": axis.name, "subject": subject, "method": method}
    told = {key: value for key, value in found.items() if key not in ORIGIN}
    return {**about, "step": step, "label": axis.label(step), **told}


def is_unusable(axis: Axis, row: Row) -> bool:
    """No picture, or one that is no use."""
    if row["outcome"] != MEASURED:
        return True
    return axis.has_floor and (row["psnr"] < LEAST_DB or (row["lpips"] or 0.0) > MOST_LPIPS)


def is_broken(axis: Axis, row: Row, undisturbed: Row) -> bool:
    """Plainly worse than the `undisturbed` one, or no use where that one was."""
    if row["outcome"] != MEASURED or undisturbed["outcome"] != MEASURED:
        return True
    if is_unusable(axis, row) and not is_unusable(axis, undisturbed):
        return True
    if row["psnr"] < undisturbed["psnr"] - LOST_DB:
        return True
    if row["lpips"] is None or undisturbed["lpips"] is None:
        return False
    return row["lpips"] > (1.0 + LOST_LPIPS) * undisturbed["lpips"]


@dataclass(frozen=True)
class Reach:
    """How far along its way an axis goes before something happens."""

    last: str | None
    """The step before it; None where it happens undisturbed already."""
    at: str | None
    """The step of it; None where it never happens."""
    share: float
    """Of the axis' way."""

    @classmethod
    def of(cls, axis: Axis, rows: list[Row], happened: Callable[[Row], bool]) -> Reach:
        """Of `rows` by rising disturbance."""
        first = next((n for n, row in enumerate(rows) if happened(row)), len(rows))
        way = axis.steps.index(rows[first - 1]["step"]) if first else 0
        return cls(
            rows[first - 1]["label"] if first else None,
            rows[first]["label"] if first < len(rows) else None,
            way / (len(axis.steps) - 1),
        )


@dataclass(frozen=True)
class BreakingPoint:
    """Of one axis, subject and method."""

    axis: str
    subject: str
    method: str
    broken: Reach
    unusable: Reach


def breaking_points(axes: Mapping[str, Axis], rows: Iterable[Row]) -> list[BreakingPoint]:
    """Of every axis, subject and method that was measured undisturbed and at another step."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        if row["axis"] in axes:
            groups.setdefault((row["axis"], row["subject"], row["method"]), []).append(row)
    points = []
    for (name, subject, method), mine in groups.items():
        axis = axes[name]
        ordered = sorted(mine, key=lambda row, axis=axis: axis.steps.index(row["step"]))
        if len(ordered) < 2 or ordered[0]["step"] != axis.steps[0]:
            continue
        broken = Reach.of(
            axis, ordered, lambda row, axis=axis, first=ordered[0]: is_broken(axis, row, first)
        )
        unusable = Reach.of(axis, ordered, lambda row, axis=axis: is_unusable(axis, row))
        points.append(BreakingPoint(name, subject, method, broken, unusable))
    return points
