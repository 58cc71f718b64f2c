"""`metanerf bench parsimony`, `ablation` and `install`: no more model and code than is needed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmarks.cli_options import (
    Assets,
    ClockName,
    Commits,
    Footage,
    LpipsBackbone,
    Motion,
    Only,
    landmark_models,
    start,
)
from benchmarks.inputs import (
    FOOTAGE,
    HUMAN_ASSETS,
    LPIPS_BACKBONE,
    MOTION,
    require_human_assets,
    require_motion,
    require_real_footage,
)

if TYPE_CHECKING:
    from benchmarks.parsimony.subjects import OutsideData

app = typer.Typer()


@app.command()
def parsimony(
    commits: Commits = False,
    motion: Motion = MOTION,
    assets: Assets = HUMAN_ASSETS,
    footage: Footage = FOOTAGE,
    backbone: LpipsBackbone = LPIPS_BACKBONE,
    clock: ClockName = "processor",
    quick: Annotated[
        bool, typer.Option("--quick", help="A small performer alone, in a few sizes.")
    ] = False,
    only: Only = "",
) -> None:
    """How much model a person needs: a ladder of sizes, and each part of the method left out."""
    from benchmarks.parsimony.measure import run
    from benchmarks.parsimony.subjects import OutsideData
    from benchmarks.real.measure import Networks
    from renderer.evaluation.lpips import PACKAGED_BACKBONE

    writer = start("parsimony", commits, narrowed=quick or bool(only) or clock != "processor")
    if quick:
        networks = Networks(footage, footage, footage, PACKAGED_BACKBONE)
        outside = OutsideData(motion, assets, footage, networks)
    else:
        outside = _outside_data(motion, assets, footage, backbone)
    run(writer, outside, clock, only, quick=quick)


@app.command()
def ablation(
    commits: Commits = False,
    motion: Motion = MOTION,
    assets: Assets = HUMAN_ASSETS,
    footage: Footage = FOOTAGE,
    backbone: LpipsBackbone = LPIPS_BACKBONE,
    clock: ClockName = "processor",
    only: Only = "",
) -> None:
    """What each part of training and capture is worth to real people, left out alone."""
    from benchmarks.parsimony.ablation import run

    outside = _outside_data(motion, assets, footage, backbone)
    writer = start("ablation", commits, narrowed=bool(only) or clock != "processor")
    run(writer, outside, clock, only)


def _outside_data(motion: Path, assets: Path, footage: Path, backbone: Path) -> OutsideData:
    """Raises InvalidInput where any of it is missing."""
    from benchmarks.parsimony.subjects import OutsideData
    from benchmarks.real.measure import Networks

    require_motion(motion)
    require_human_assets(assets)
    require_real_footage(footage)
    return OutsideData(motion, assets, footage, Networks(*landmark_models(), backbone))


@app.command()
def install(
    commits: Commits = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Install all of it from nothing, too: by PyPI and npm.")
    ] = False,
) -> None:
    """What the code weighs: packages, start-up, lines, settings, a new installation."""
    from benchmarks.install.measure import run

    run(start("install", commits), fresh=fresh)
