"""`metanerf bench load` and `bench faults`: what a whole service bears."""

from __future__ import annotations

from typing import Annotated

import typer

from benchmarks.cli_options import Commits, start

_SECONDS = 20.0


def load(
    commits: Commits = False,
    seconds: Annotated[
        float, typer.Option(help="Time of measuring each number of meetings.", min=1.0)
    ] = _SECONDS,
) -> None:
    """How many meetings of four one gateway holds, its memory over minutes, and overload."""
    from benchmarks.load.measure import LoadEffort, run

    run(start("load", commits, narrowed=seconds != _SECONDS), LoadEffort(seconds=seconds))


def faults(
    commits: Commits = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Without PostgreSQL, Redis, an S3 store and root.")
    ] = False,
) -> None:
    """Parts of a service are killed one by one: what a meeting sees, and what is lost."""
    from benchmarks.faults.measure import run

    run(start("faults", commits, narrowed=quick), quick=quick)


def renderers(commits: Commits = False) -> None:
    """Drawing for a viewer in the gateway and outside it: the cost, and the end of a renderer."""
    from benchmarks.renderers import run

    run(start("renderers", commits))
