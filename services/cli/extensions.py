"""Groups of commands that packages above `services` add to `metanerf`.

They are declared as entry points of the group `metanerf.commands`, so that nothing here imports
those packages by name.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import typer

_GROUP = "metanerf.commands"
_CHECKOUT = Path(__file__).parents[2]


def command_groups(checkout: Path = _CHECKOUT) -> Iterator[tuple[str, typer.Typer]]:
    """Name and commands of every group.

    In a checkout its own `pyproject.toml` is read, since what is installed may be older or another
    checkout's; without one, what is installed.
    """
    declared = checkout / "pyproject.toml"
    if declared.exists():
        groups = tomllib.loads(declared.read_text())["project"].get("entry-points", {})
        found = [EntryPoint(name, value, _GROUP) for name, value in groups.get(_GROUP, {}).items()]
    else:
        found = list(entry_points(group=_GROUP))
    for point in found:
        yield point.name, point.load()
