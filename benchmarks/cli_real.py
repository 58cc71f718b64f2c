"""`metanerf bench real`, `bench live-look` and `bench levels`: people whom nobody modelled."""

from __future__ import annotations

from typing import Annotated

import typer

from benchmarks.cli_options import (
    Assets,
    Commits,
    Footage,
    LpipsBackbone,
    Only,
    landmark_models,
    start,
)
from benchmarks.inputs import (
    FOOTAGE,
    HUMAN_ASSETS,
    LPIPS_BACKBONE,
    require_browser,
    require_human_assets,
    require_real_footage,
)
from benchmarks.real.cases import ITERATIONS

Iterations = Annotated[int, typer.Option(min=1, help="Steps of each training.")]


def real(
    commits: Commits = False,
    footage: Footage = FOOTAGE,
    backbone: LpipsBackbone = LPIPS_BACKBONE,
    iterations: Iterations = ITERATIONS,
    only: Only = "",
) -> None:
    """Models of real people on frames, clips and cameras that they never saw, and how they look."""
    require_real_footage(footage)
    from benchmarks.real.measure import Networks, run

    networks = Networks(*landmark_models(), backbone)
    writer = start("real", commits, narrowed=bool(only) or iterations != ITERATIONS)
    run(writer, footage, networks, iterations, only)


def live_look(
    commits: Commits = False,
    footage: Footage = FOOTAGE,
    backbone: LpipsBackbone = LPIPS_BACKBONE,
    iterations: Iterations = ITERATIONS,
    only: Only = "",
    assets: Assets = HUMAN_ASSETS,
) -> None:
    """Models of real people, coloured by the frames of other clips of theirs as a webcam sends; of
    lifelike performers, who are seen from beside their webcam as they truly are; and what models
    learn from pictures that were kept."""
    require_real_footage(footage)
    require_human_assets(assets)
    from benchmarks.real.live_look import run
    from benchmarks.real.measure import Networks

    networks = Networks(*landmark_models(), backbone)
    writer = start("live-look", commits, narrowed=bool(only) or iterations != ITERATIONS)
    run(writer, footage, networks, iterations, only, assets=assets)


def live_head(commits: Commits = False, footage: Footage = FOOTAGE) -> None:
    """Heads of real people, live: how far they are from where their faces' points have them."""
    require_real_footage(footage)
    from benchmarks.real.live_head import run

    pose, face, _ = landmark_models()
    run(start("live-head", commits), footage, pose, face)


def levels(
    commits: Commits = False,
    footage: Footage = FOOTAGE,
) -> None:
    """People by fewer splats: dB where they are small, and pictures a second of a full room."""
    require_real_footage(footage)
    require_browser()
    from benchmarks.levels import run
    from benchmarks.real.measure import Networks

    run(start("levels", commits), footage, Networks(*landmark_models(), LPIPS_BACKBONE))
