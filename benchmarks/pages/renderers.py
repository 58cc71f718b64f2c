"""Homes of drawing, as docs/streaming.md shows them."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_HOMES = {"here": "the gateway's own thread", "processes": "a child process"}


def renderers(figures: Figures) -> str:
    """What a picture takes in each home, and how soon pictures come again after a death."""
    heads = [
        "drawn by",
        "drawn and encoded, ms: median (95th percentile)",
        "on the way beyond that, ms",
        "pictures come again after it is killed, s: median (longest)",
    ]
    rows = [
        [_HOMES[row["home"]], _pair(row, "made"), _pair(row, "way"), _again(row["again_s"])]
        for row in figures["rows"]
    ]
    sentence = (
        f"One viewer, 512 x 512 px, one person, {figures['pictures']} pictures "
        "(`metanerf bench renderers`):"
    )
    return "\n\n".join([sentence, markdown_table(heads, rows), measured_at(figures)])


def _pair(row: Figures, name: str) -> str:
    return f"{row[f'{name}_p50_ms']:.1f} ({row[f'{name}_p95_ms']:.1f})"


def _again(seconds: list[float]) -> str:
    if not seconds:
        return "-"
    return f"{sorted(seconds)[len(seconds) // 2]:.1f} ({max(seconds):.1f})"
