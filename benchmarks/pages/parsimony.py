"""The tables of docs/parsimony.md."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_NOISE = 2.0
"""Standard errors within which a difference is nothing."""
_PARTS = ("body", "face")
_COSTS = ["parameters", "MB", "ms a view", "training, s"]


def parsimony(figures: Figures) -> str:
    """Sizes, the ladders, and what each part is worth."""
    return "\n\n".join(
        [
            f"LPIPS is on `{figures['lpips']}`; seconds and milliseconds are of one thread.",
            "![Accuracy against megabytes](figures/parsimony.png)",
            "### As few as the clip shows a need for",
            _sizes(figures),
            "### The ladder of splats",
            *_ladders(figures),
            *_field(figures),
            "### Each part left out alone",
            "What the whole method is better by: dB / LPIPS x1000 of the body, and of the face; "
            "the mean over seeds ± its standard error. **Bold**: more than noise.",
            _worth(figures),
            measured_at(figures),
        ]
    )


def _sizes(figures: Figures) -> str:
    head = ["person", "splats", "kept", "MB", "ms a view", "training, s", "body", "face"]
    rows = []
    for subject in figures["subjects"]:
        full, auto = (_mean(figures["rows"], subject["name"], "size", n) for n in ("full", "auto"))
        if full is None or auto is None:
            continue
        rows.append(
            [
                f"{subject['name']}: {subject['words']}",
                f"{full['splats']:,.0f}",
                f"{auto['splats']:,.0f}",
                f"{full['viewer_megabytes']:.2f} -> {auto['viewer_megabytes']:.2f}",
                f"{full['p50_ms']:.1f} -> {auto['p50_ms']:.1f}",
                f"{full['training_s']:.1f} -> {auto['training_s']:.1f}",
                *(f"{_accuracy(full, part)} -> {_accuracy(auto, part)}" for part in _PARTS),
            ]
        )
    return markdown_table(head, rows)


_RUNGS = {
    "number": "{} splats",
    "size": "as many as the clip shows pixels",
    "pictures": "the same, pictures of {} px",
    "expressions": "the same, half of the expressions",
    "without": "the same, no expressions",
}
"""A ladder's groups in their order, and how their rungs are told."""


def _ladders(figures: Figures) -> Iterator[str]:
    """A table a person."""
    for subject in figures["subjects"]:
        rows = [row for row in figures["rows"] if row["subject"] == subject["name"]]
        parts = [one for one in _PARTS if any(row.get(f"{one}_psnr") for row in rows)]
        shown = []
        for group, words in _RUNGS.items():
            names = dict.fromkeys(row["name"] for row in rows if row["group"] == group)
            for name in names:
                if group in ("size", "without") and name not in ("full", "expressions"):
                    continue
                found = _mean(rows, subject["name"], group, name)
                assert found is not None
                told = f"{int(name):,}" if name.isdigit() else name
                accuracies = [_accuracy(found, part) for part in parts]
                shown.append([words.format(told), *accuracies, *_costs(found, "viewer_megabytes")])
        if shown:
            yield f"**{subject['name']}**: {subject['words']}"
            heads = [f"{part}, dB / LPIPS" for part in parts]
            yield _filled_table(["trained with", *heads, *_COSTS], shown)


def _field(figures: Figures) -> list[str]:
    """What is changed about it, a row each: costs are of the first who has it."""
    rows = [row for row in figures["rows"] if row["group"] == "field"]
    if not rows:
        return []
    subjects = list(dict.fromkeys(row["subject"] for row in rows))
    shown = []
    for name in dict.fromkeys(row["name"] for row in rows):
        found = [_mean(rows, subject, "field", name) for subject in subjects]
        cost = next(one for one in found if one is not None)
        accuracies = ["" if one is None else _body_and_face(one) for one in found]
        shown.append([name, *accuracies, *_costs(cost, "megabytes")])
    table = markdown_table(["body; face, dB / LPIPS", *subjects, *_COSTS], shown)
    return ["### The ladder of a neural field", table]


def _body_and_face(row: dict[str, float]) -> str:
    faces = [_accuracy(row, "face")] if "face_psnr" in row else []
    return "; ".join([_accuracy(row, "body"), *faces])


def _costs(row: dict[str, float], megabytes: str) -> list[str]:
    parameters = row.get("parameters")
    return [
        "" if parameters is None else _counted(parameters),
        f"{row[megabytes]:.2f}",
        f"{row['p50_ms']:.1f}",
        f"{row['training_s']:.0f}",
    ]


def _filled_table(head: list[str], rows: list[list[str]]) -> str:
    """Without columns in which no row has anything."""
    filled = [column for column in range(len(head)) if any(row[column] for row in rows)]
    chosen = [[row[column] for column in filled] for row in [head, *rows]]
    return markdown_table(chosen[0], chosen[1:])


def _counted(number: float) -> str:
    return f"{number / 1e6:.2f} M" if number >= 1e6 else f"{number / 1e3:.1f} k"


def _worth(figures: Figures) -> str:
    names = list(dict.fromkeys(row["subject"] for row in figures["worth"]))
    parts = dict.fromkeys(row["name"] for row in figures["worth"])
    rows = []
    for part in parts:
        of = {row["subject"]: row for row in figures["worth"] if row["name"] == part}
        rows.append([part, *(_gains(of.get(name)) for name in names)])
    return markdown_table(["left out", *names], rows)


def _gains(row: dict[str, Any] | None) -> str:
    if row is None:
        return ""
    return "; ".join(gain(row, part) for part in _PARTS if f"{part}_psnr" in row)


def gain(row: dict[str, Any], part: str) -> str:
    """dB / LPIPS x1000 that the whole method is better by on a `part` of the picture."""
    psnr = certain(row, f"{part}_psnr", 1.0, 2)
    return f"{psnr} / {certain(row, f'{part}_lpips', -1e3, 1)}"


def certain(row: dict[str, Any], measure: str, factor: float, digits: int) -> str:
    """The gain ± its standard error; of measures that fall, such as LPIPS, by a negative factor."""
    error = row[f"{measure}_spread"] / max(np.sqrt(row["seeds"] - 1), 1.0)
    words = f"{factor * row[measure]:+.{digits}f} ± {abs(factor) * error:.{digits}f}"
    return f"**{words}**" if abs(row[measure]) > _NOISE * error else words


def _accuracy(row: dict[str, float], part: str) -> str:
    psnr, lpips = row.get(f"{part}_psnr"), row.get(f"{part}_lpips")
    return "-" if psnr is None or lpips is None else f"{psnr:.1f} / {lpips:.3f}"


def _mean(
    rows: list[dict[str, Any]], subject: str, group: str, name: str
) -> dict[str, float] | None:
    """Over seeds."""
    chosen = [r for r in rows if (r["subject"], r["group"], r["name"]) == (subject, group, name)]
    return _means(chosen) if chosen else None


def _means(rows: list[dict[str, Any]]) -> dict[str, float]:
    numbers = [key for key, value in rows[0].items() if isinstance(value, int | float)]
    return {key: float(np.mean([row[key] for row in rows])) for key in numbers}
