"""The tables of docs/parsimony.md that say what each part of the method is worth."""

from __future__ import annotations

from typing import Any

from benchmarks.pages.parsimony import certain, gain
from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_UNSEEN = {name: name for name in ("front", "beside", "behind")}
_SHOWN = {
    "body": "body",
    "face": "face",
    "hands": "hands",
    "another clip: body": "other_body",
    "another clip: hands": "other_hands",
}
"""Columns, each with how its measures begin."""
_POINTS = "face's points / irises, %"


def ablation(figures: Figures) -> str:
    """What each part is worth on real people, and on lifelike ones whose sides are known."""
    tables = [_table(figures, _UNSEEN), _table(figures, _SHOWN, points=True)]
    judged = {row["subject"] for row in figures["worth"]}
    people = [one for one in figures["people"] if one["name"] in judged]
    return "\n\n".join(
        [
            "What the whole method is better by than without the part, dB / LPIPS x1000 on "
            f"`{figures['lpips']}`: the mean over seeds ± its standard error. **Bold**: more than "
            f"noise. By `{figures['command']}`.",
            *(table for table in tables if table is not None),
            "; ".join(f"{one['name']}: {one['words']}" for one in people) + ".",
            measured_at(figures),
        ]
    )


def _table(figures: Figures, columns: dict[str, str], *, points: bool = False) -> str | None:
    """None where nobody was judged so."""
    rows = []
    for row in sorted(figures["worth"], key=lambda one: one["name"]):
        shown = [gain(row, begin) if f"{begin}_psnr" in row else "" for begin in columns.values()]
        if any(shown):
            face = [_points(row)] if points else []
            rows.append([row["name"], row["subject"], *shown, *face])
    head = ["left out", "person", *columns, *([_POINTS] if points else [])]
    return markdown_table(head, rows) if rows else None


def _points(row: dict[str, Any]) -> str:
    names = [f"face_{name}_percent" for name in ("points", "irises")]
    return " / ".join(certain(row, name, -1.0, 2) for name in names) if names[0] in row else ""
