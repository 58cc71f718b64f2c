"""`metanerf bench stability`: where methods fail."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.cli_options import Assets, Commits, Footage, Motion, Only, landmark_models, start
from benchmarks.inputs import (
    FOOTAGE,
    HUMAN_ASSETS,
    MOTION,
    require_cuda,
    require_human_assets,
    require_motion,
    require_real_footage,
)
from scene.errors import InvalidInput
from services.cli.terminal import seconds

_STEPS = 3


def stability(
    commits: Commits = False,
    motion: Motion = MOTION,
    assets: Assets = HUMAN_ASSETS,
    footage: Footage = FOOTAGE,
    steps: Annotated[
        int, typer.Option(help="Of each axis, the first and the last among them.", min=2)
    ] = _STEPS,
    quick: Annotated[
        bool, typer.Option("--quick", help="A corner of it in a minute or two, without any data.")
    ] = False,
    only: Only = "",
    within: Annotated[
        str, typer.Option(help="Begin nothing later; report what there is. Empty: no limit.")
    ] = "",
) -> None:
    """Where methods fail: one thing of capture, training or a meeting is disturbed at a time."""
    from benchmarks.stability.measure import QUICK, StabilityEffort, run
    from benchmarks.stability.subjects import SubjectSources

    writer = start("stability", commits, narrowed=quick or bool(only) or steps != _STEPS)
    if quick:
        with tempfile.TemporaryDirectory() as folder:
            run(writer, SubjectSources(Path(folder), size_px=128, frames=24), QUICK, only)
        return
    require_motion(motion)
    inputs = SubjectSources(
        writer.measurements / "material",
        motion,
        assets if _at_hand(require_human_assets, assets) else None,
        footage if _at_hand(require_real_footage, footage) else None,
        landmark_models(),
    )
    run(writer, inputs, StabilityEffort(steps=steps), only, seconds(within) if within else math.inf)


def paper_stability(commits: Commits = False, motion: Motion = MOTION) -> None:
    """Where the paper's own field fails, and splats of the same clips: needs a GPU."""
    import torch

    from benchmarks.stability.paper import PaperEffort, run
    from benchmarks.stability.subjects import SubjectSources

    require_cuda()
    require_motion(motion)
    writer = start("paper-stability", commits)
    inputs = SubjectSources(writer.measurements / "material", motion)
    run(writer, inputs, torch.cuda.get_device_name(), PaperEffort())


def _at_hand(require: Callable[[Path], None], folder: Path) -> bool:
    try:
        require(folder)
    except InvalidInput as error:
        typer.echo(f"left out: {error}")
        return False
    return True
