"""Where an axis breaks: pictures are plainly worse than undisturbed, or no use at all."""

from __future__ import annotations

from typing import Any

from benchmarks.stability.axis import Axis
from benchmarks.stability.judge import MEASURED

LOST_DB, LOST_LPIPS = 3.0, 0.5
"""Lost against the undisturbed step: dB, and the share by which LPIPS grows."""
LEAST_DB, MOST_LPIPS = 24.0, 0.25
"""Below or above, a picture is no use, whatever it was before."""

Row = dict[str, Any]
"""One measurement: its axis, subject, method and step, the outcome and figures."""


def is_unusable(axis: Axis, row: Row) -> bool:
    """No picture, or one that is no use."""
    if row["outcome"] != MEASURED:
        return True
    return axis.has_floor and (row["psnr"] < LEAST_DB or (row["lpips"] or 0.0) > MOST_LPIPS)


def is_broken(axis: Axis, row: Row, undisturbed: Row) -> bool:
    """The same, or plainly worse than the `undisturbed` one."""
    if is_unusable(axis, row) or undisturbed["outcome"] != MEASURED:
        return True
    if row["psnr"] < undisturbed["psnr"] - LOST_DB:
        return True
    if row["lpips"] is None or undisturbed["lpips"] is None:
        return False
    return row["lpips"] > (1.0 + LOST_LPIPS) * undisturbed["lpips"]


def breaking_point(axis: Axis, rows: list[Row]) -> dict[str, Any]:
    """Of one axis, subject and method, whose `rows` are by rising disturbance.

    `holds_to` is the last step before the first broken one (None where the undisturbed one is),
    `breaks_at` that one (None where none is), `unusable_at` the first that is no use; `held` is how
    far the axis holds as a share of its way.
    """
    broken = [is_broken(axis, row, rows[0]) for row in rows]
    first = broken.index(True) if any(broken) else len(rows)
    useless = next((row["label"] for row in rows if is_unusable(axis, row)), None)
    reached = axis.steps.index(rows[first - 1]["step"]) if first else 0
    return {
        "holds_to": rows[first - 1]["label"] if first else None,
        "breaks_at": rows[first]["label"] if first < len(rows) else None,
        "unusable_at": useless,
        "held": round(reached / (len(axis.steps) - 1), 3),
    }


def breaking_points(axes: dict[str, Axis], rows: list[Row]) -> list[dict[str, Any]]:
    """Of every axis, subject and method in `rows`."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["axis"], row["subject"], row["method"]), []).append(row)
    points = []
    for (name, subject, method), mine in groups.items():
        ordered = sorted(mine, key=lambda row, axis=axes[name]: axis.steps.index(row["step"]))
        if ordered[0]["step"] == axes[name].steps[0]:
            about = {"axis": name, "subject": subject, "method": method}
            points.append({**about, **breaking_point(axes[name], ordered)})
    return points
