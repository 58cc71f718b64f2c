"""The command's tree, and how its errors reach a person: one line, no traceback, exit code 1."""

from __future__ import annotations

import sys
from functools import cache

import typer

from scene.errors import SceneError
from services.cli import backups, examination, joining, models, recordings, sequences, serving
from services.cli.extensions import command_groups

app = typer.Typer(
    name="metanerf",
    help="Meetings in which a person recorded by one camera is seen from any side.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for module in (serving, joining, sequences, models, recordings, backups, examination):
    app.registered_commands += module.app.registered_commands


def main() -> None:
    """Run the command line; errors that we raise on purpose are printed without a traceback."""
    _add_command_groups()
    try:
        app()
    except Exception as error:
        told = _told(error)
        if told is None:
            raise
        typer.secho(f"metanerf: {told}", fg=typer.colors.RED, err=True)
        sys.exit(1)


@cache
def _add_command_groups() -> None:
    """Once, and not on import: the modules of the groups import from `services.cli`."""
    for name, group in command_groups():
        app.add_typer(group, name=name)


def _told(error: Exception) -> str | None:
    """What to tell of `error`; None for one that nobody foresaw."""
    from db.objects import no_space

    if isinstance(error, SceneError):
        return str(error)
    if full := no_space(error):
        return full
    if isinstance(error, OSError) and error.filename:
        return (
            f"{error.filename} must be a place that can be read or written; "
            f"got: {error.strerror}; choose another"
        )
    return None
