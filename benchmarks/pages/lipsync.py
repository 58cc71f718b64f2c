"""Lips and voice, as docs/streaming.md shows them."""

from __future__ import annotations

from benchmarks.pages.provenance import Figures, measured_at
from benchmarks.reporting.markdown import markdown_table

_WAYS = {
    "server": "the server's picture",
    "page": "the page's own picture",
    "replay": "a recording, on the page",
    "video": "a recording, as a video",
}


def lipsync(figures: Figures) -> str:
    """How much later lips are seen than the voice is heard, by way and by what finding takes."""
    found = sorted({row["found_after_ms"] for row in figures["rows"]})
    cells = {(row["seen_in"], row["found_after_ms"]): _cell(row) for row in figures["rows"]}
    heads = ["seen in", *(f"landmarks found within {ms} ms" for ms in found)]
    rows = [[name, *(cells[way, ms] for ms in found)] for way, name in _WAYS.items()]
    sentence = (
        "By how many ms lips are seen after the voice is heard, median (5th to 95th percentile of "
        f"{min(row['openings'] for row in figures['rows'])} and more openings); below 0, before it "
        "(`metanerf bench lipsync`):"
    )
    up = (
        "Landmarks of body, face and hands, and a viewpoint thrice a second, go up at "
        f"{figures['landmarks_mbit_s']:.3f} Mbit/s, headers of every layer down to IP included."
    )
    return "\n\n".join([sentence, markdown_table(heads, rows), up, measured_at(figures)])


def _cell(row: Figures) -> str:
    low, middle, high = (row[f"lips_after_voice_{part}_ms"] for part in ("p5", "p50", "p95"))
    return f"{middle} ({low} to {high})"
