"""What a page says of where its figures come from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

Figures = dict[str, Any]
"""What a file of docs/figures holds."""
_ROWS = ("rows", "accuracy", "speed", "steps", "cases")
"""Lists, or tables by name, whose rows may have been measured at commits of their own."""
CHANGED = "\\*"
"""Marks a commit whose tree had changes that no commit holds."""


def measured_at(figures: Figures) -> str:
    """The sentence under a table: commit, date, processor, and what makes them less certain."""
    alike: dict[tuple[Any, ...], list[Figures]] = {}
    for origin in _origins(figures):
        processor = origin["machine"]["processor"]
        of = (origin["commit"], origin["uncommitted_changes"], origin["date"][:10], processor)
        alike.setdefault((*of, origin.get("date_from")), []).append(origin)
    return f"Measured at {' and '.join(map(_sentence, alike.values()))}."


def short_origin(figures: Figures) -> str:
    """The same for a table's cell: date, commit and processor."""
    changed = CHANGED if figures["uncommitted_changes"] else ""
    machine = figures["machine"]["processor"]
    return f"{figures['date'][:10]}, `{figures['commit']}`{changed}, {machine}"


def _origins(figures: Figures) -> Iterator[Figures]:
    found = [figures.get(name, ()) for name in _ROWS]
    lists = [[*rows.values()] if isinstance(rows, dict) else rows for rows in found]
    told = [row for rows in lists for row in rows if "commit" in row]
    yield from told
    # rows beside them that tell nothing are of the file's own commit
    if not told or any(0 < sum("commit" in row for row in rows) < len(rows) for rows in lists):
        yield figures


def _sentence(origins: list[Figures]) -> str:
    """Of one commit, date and processor, which may have been busier at one row than at another."""
    first = origins[0]
    changes = " with uncommitted changes" if first["uncommitted_changes"] else ""
    notes = [
        first["machine"]["processor"],
        *_loop([one["machine"]["loop_ms"] for one in origins if "loop_ms" in one["machine"]]),
        *([first["date_from"]] if "date_from" in first else []),
    ]
    return f"`{first['commit']}`{changes} on {first['date'][:10]} ({', '.join(notes)})"


def _loop(milliseconds: list[float]) -> list[str]:
    """What the reference loop took, if it ran."""
    if not milliseconds:
        return []
    least, most = min(milliseconds), max(milliseconds)
    return [f"reference loop {least:g}{'' if least == most else f' to {most:g}'} ms"]
