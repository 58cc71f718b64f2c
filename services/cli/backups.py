"""Commands that copy everything and bring it back: backup, restore."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path
from typing import Annotated

import typer

from services.cli.terminal import progress_bar, require_writable

app = typer.Typer()

_NAME = "metanerf-%Y%m%d-%H%M%SZ.tar"
_ENCRYPTED = ".encrypted"
KeyFile = Annotated[
    Path | None,
    typer.Option(help="A file with the key, 32 bytes or more; without, nothing is encrypted."),
]
_DAYS = 30


@app.command()
def backup(
    out: Annotated[Path, typer.Argument(help="The archive to write, or a folder of archives.")],
    days: Annotated[
        int, typer.Option(help="Days after which it can't be restored any more.", min=1)
    ] = _DAYS,
    key_file: KeyFile = None,
) -> None:
    """Copy all rows and objects into one archive, while the server runs.

    In a folder, archives of before that are older than `--days` are deleted.
    """
    from db.backup import back_up
    from db.encrypted_file import read_secret
    from services.composition import build_services
    from services.settings import load_settings

    secret = None if key_file is None else read_secret(key_file)
    services = build_services(load_settings())
    now, keep_for = services.clock(), timedelta(days=days)
    name = now.strftime(_NAME) + ("" if secret is None else _ENCRYPTED)
    path = out / name if out.is_dir() else out
    require_writable(path)
    with progress_bar("backup") as report:
        made = back_up(services.database, services.objects, path, now, keep_for, report, secret)
    services.close()
    typer.echo(
        f"{path}: {sum(made.rows.values())} rows, {made.objects} objects, {made.bytes} bytes; "
        f"to be forgotten by {made.forget_by}"
    )
    for name in made.lost:
        typer.secho(f"not in the store, or damaged there: {name}", fg=typer.colors.RED, err=True)
    for old in _expired(path.parent, now - keep_for) if out.is_dir() else []:
        old.unlink()
        typer.echo(f"{old} was too old, and is deleted")
    if made.lost:
        raise typer.Exit(1)


@app.command()
def restore(
    archive: Annotated[Path, typer.Argument(help="What `metanerf backup` has written.")],
    key_file: KeyFile = None,
) -> None:
    """Put an archive into an empty database and store, once all of it is found whole."""
    from db.encrypted_file import read_secret
    from db.restore import restore as put_back
    from services.composition import build_services
    from services.settings import load_settings

    secret = None if key_file is None else read_secret(key_file)
    services = build_services(load_settings())
    with progress_bar("restore") as report:
        now = services.clock()
        made = put_back(services.database, services.objects, archive, now, report, secret)
    services.close()
    typer.echo(
        f"{sum(made.rows.values())} rows and {made.objects} objects of {made.made_at} are back; "
        "erase again whoever was erased since"
    )


def _expired(folder: Path, before: datetime) -> list[Path]:
    """Archives that were made before a moment, by their names."""
    found = []
    for path in sorted(folder.glob("metanerf-*.tar*")):
        try:
            made = datetime.strptime(path.name.removesuffix(_ENCRYPTED), _NAME).replace(
                tzinfo=before.tzinfo
            )
        except ValueError:  # of another's making
            continue
        if made < before:
            found.append(path)
    return found
