"""What long commands share: a progress bar, Ctrl-C as a wish to stop, durations as people write."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column, Table
from rich.text import Text

from renderer.splats.settings import Size
from scene.errors import InvalidInput

Report = Callable[[float, str], None]
"""Told the share that is done, and what is being done."""

_BAR_COLUMNS = 18
_LEAST_SPLATS = 100
_SECONDS = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}


def seconds(text: str) -> float:
    """Seconds of a duration such as `20s`, `1.5m`, `2h` or `90`."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|m|min|h)?\s*", text)
    if match is None or float(match[1]) <= 0.0:
        raise typer.BadParameter(f"a duration must look like 20s, 1.5m or 2h; got {text!r}")
    return float(match[1]) * _SECONDS[match[2] or ""]


def splats_kept(text: str) -> Size:
    """The size of a model as people write it: `auto`, `full`, or a number of splats."""
    if text == "auto" or text == "full":
        return text
    if not text.isdigit() or int(text) < _LEAST_SPLATS:
        raise typer.BadParameter(
            f"a size must be auto, full or a number from {_LEAST_SPLATS}; got {text!r}"
        )
    return int(text)


def require_writable(out: Path) -> None:
    """Before long work: `out`, or the nearest folder above it, is there to be written.

    Raises InvalidInput; makes nothing.
    """
    folder = next(above for above in out.absolute().parents if above.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        what = "a folder that may not be written" if folder.is_dir() else "a file, no folder"
        raise InvalidInput(f"{out} must be where it can be written; got {folder}: {what}")


@contextmanager
def progress_bar(title: str, console: Console | None = None) -> Iterator[Report]:
    """A bar on the terminal (`console`: stderr); yields `report(fraction, message)`."""
    columns = (
        TextColumn("[bold]{task.description}"),
        BarColumn(bar_width=_BAR_COLUMNS),
        TextColumn("{task.percentage:>3.0f} %"),
        # on a narrow terminal words give way, not the bar
        TextColumn("{task.fields[message]}", table_column=Column(ratio=1, no_wrap=True)),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console or Console(stderr=True), expand=True) as progress:
        task = progress.add_task(title, total=1.0, message="")

        def report(fraction: float, message: str) -> None:
            progress.update(task, completed=min(1.0, max(0.0, fraction)), message=message)

        yield report


def print_table(rows: Iterable[tuple[str, str, str]]) -> None:
    """Rows of three: what, value, verdict; a verdict that is not `good` stands out."""
    table = Table(show_header=False, box=None, padding=(0, 2))
    for what, value, verdict in rows:
        table.add_row(what, value, Text(verdict, style="" if verdict == "good" else "bold"))
    Console().print(table)


@contextmanager
def stop_on_interrupt() -> Iterator[Callable[[], bool]]:
    """Turns the first Ctrl-C (or SIGTERM) into `should_stop()`; the second ends the program."""
    asked = False

    def ask(_signal: int, _frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        typer.secho("\nstopping: what is done so far is kept (again: at once)", err=True)

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
