"""The tables of docs/parsimony.md."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_NOISE = 2.0
"""Standard errors within which a difference is nothing."""


def parsimony(figures: Figures) -> str:
    """Sizes, the ladder, and what each part is worth."""
    return "\n\n".join(
        [
            f"LPIPS is on `{figures['lpips']}`; seconds and milliseconds are of one thread.",
            "![Accuracy against megabytes](figures/parsimony.png)",
            "### As few as the clip shows a need for",
            _sizes(figures),
            "### The ladder",
            _ladder(figures),
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


_PARTS = ("body", "face")


def _ladder(figures: Figures) -> str:
    names = [subject["name"] for subject in figures["subjects"]]
    keys = dict.fromkeys(
        (row["group"], row["name"])
        for row in figures["rows"]
        if row["group"] in ("number", "pictures")
    )
    rows = []
    for group, name in keys:
        found = [_mean(figures["rows"], subject, group, name) for subject in names]
        words = f"{int(name):,} splats" if group == "number" else f"pictures of {name} px"
        rows.append([words, *("" if one is None else _cell(one) for one in found)])
    return markdown_table(["body, dB / LPIPS; MB; training", *names], rows)


def _cell(row: dict[str, float]) -> str:
    return f"{_accuracy(row, 'body')}; {row['viewer_megabytes']:.2f}; {row['training_s']:.0f} s"


def _worth(figures: Figures) -> str:
    names = [subject["name"] for subject in figures["subjects"]]
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
    if not chosen:
        return None
    numbers = [key for key, value in chosen[0].items() if isinstance(value, int | float)]
    return {key: float(np.mean([row[key] for row in chosen])) for key in numbers}
