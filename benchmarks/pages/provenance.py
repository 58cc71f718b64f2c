"""What a page says of where its figures come from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

Figures = dict[str, Any]
"""What a file of docs/figures holds."""
_ROWS = ("rows", "accuracy", "speed", "steps")
"""Lists whose rows may have been measured at commits of their own."""
CHANGED = "\\*"
"""Marks a commit whose tree had changes that no commit holds."""


def measured_at(figures: Figures) -> str:
    """The sentence under a table: commit, date, processor, and what makes them less certain."""
    told = dict.fromkeys(_sentence(origin) for origin in _origins(figures))
    return f"Measured at {' and '.join(told)}."


def short_origin(figures: Figures) -> str:
    """The same for a table's cell: date, commit and processor."""
    changed = CHANGED if figures["uncommitted_changes"] else ""
    machine = figures["machine"]["processor"]
    return f"{figures['date'][:10]}, `{figures['commit']}`{changed}, {machine}"


def _origins(figures: Figures) -> Iterator[Figures]:
    rows = [row for name in _ROWS for row in figures.get(name, ()) if "commit" in row]
    yield from rows or [figures]


def _sentence(origin: Figures) -> str:
    """Of one commit."""
    changes = " with uncommitted changes" if origin["uncommitted_changes"] else ""
    machine = origin["machine"]
    notes = [
        machine["processor"],
        *([f"reference loop {machine['loop_ms']:g} ms"] if "loop_ms" in machine else []),
        *([origin["date_from"]] if "date_from" in origin else []),
    ]
    return f"`{origin['commit']}`{changes} on {origin['date'][:10]} ({', '.join(notes)})"
