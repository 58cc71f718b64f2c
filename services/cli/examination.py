"""The command that says what a machine lacks."""

from __future__ import annotations

import typer

from services.cli.terminal import print_table

app = typer.Typer()


@app.command()
def doctor() -> None:
    """Say whether this machine can serve meetings with its settings, and what to mend.

    Tries cores, GPU, encoders, stores, disk, port, UDP, the relay, landmark models (those that are
    missing are fetched) and the page. Exit code 1: something is to be mended.
    """
    from services.doctor import examine
    from services.settings import load_settings

    findings = list(examine(load_settings()))
    print_table((one.what, one.found, one.advice or "good") for one in findings)
    if any(one.advice for one in findings):
        raise typer.Exit(1)
