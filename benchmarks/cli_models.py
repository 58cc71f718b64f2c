"""Commands of `metanerf bench` that train models of people and judge them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks.cli_options import (
    Assets,
    Backbone,
    ClockName,
    Commits,
    LpipsBackbone,
    Motion,
    Only,
    Picture,
    landmark_models,
    pose_model,
    start,
)
from benchmarks.inputs import (
    HUMAN_ASSETS,
    LPIPS_BACKBONE,
    MOTION,
    PANORAMAS,
    TWO_CAMERAS,
    require_footage,
    require_human_assets,
    require_motion,
    require_panoramas,
)
from services.cli.terminal import seconds

app = typer.Typer()


@app.command()
def gpu(
    commits: Commits = False,
    train_for: Annotated[
        list[str], typer.Option(help="Train the paper's field for so long; may be repeated.")
    ] = ["60s", "180s"],  # noqa: B006 (nobody changes it)
) -> None:
    """What a CUDA device brings: splats, beside gsplat where it is installed, and the field."""
    from benchmarks.gpu import run

    narrowed = train_for != ["60s", "180s"]
    run(start("gpu", commits, narrowed=narrowed), [seconds(one) for one in train_for])


@app.command()
def frontier(
    commits: Commits = False,
    backbone: Backbone = None,
    scaled: Annotated[
        str, typer.Option(help="Time of one thread for each of the paper's presets' scaled runs.")
    ] = "30m",
    clock: ClockName = "processor",
    only: Only = "",
) -> None:
    """Speed against accuracy of all presets on one sequence, for the charts and tables."""
    from benchmarks.frontier.measure import run

    narrowed = bool(only) or clock != "processor" or scaled != "30m"
    writer = start("frontier", commits, narrowed=narrowed)
    run(writer, backbone, seconds(scaled), clock, only)


@app.command()
def performers(
    commits: Commits = False,
    motion: Motion = MOTION,
    backbone: Backbone = None,
    clock: ClockName = "processor",
    only: Only = "",
) -> None:
    """Accuracy on the studio's painted performers in real motion, in every look."""
    require_motion(motion)
    from benchmarks.performers import run

    writer = start("performers", commits, narrowed=bool(only) or clock != "processor")
    run(writer, motion, backbone, clock, only)


@app.command()
def lifelike(
    commits: Commits = False,
    motion: Motion = MOTION,
    assets: Assets = HUMAN_ASSETS,
    backbone: LpipsBackbone = LPIPS_BACKBONE,
    clock: ClockName = "processor",
    only: Only = "",
) -> None:
    """Accuracy on each lifelike performer from new views, and how that looks."""
    require_motion(motion)
    require_human_assets(assets)
    from benchmarks.lifelike import run

    writer = start("lifelike", commits, narrowed=bool(only) or clock != "processor")
    run(writer, motion, assets, backbone, clock, only)


@app.command("covered-torso")
def covered_torso(
    commits: Commits = False,
    assets: Assets = HUMAN_ASSETS,
    backbone: LpipsBackbone = LPIPS_BACKBONE,
    clock: ClockName = "processor",
    only: Only = "",
) -> None:
    """The torso where hands were in front of it, against the rest of it: lifelike performers."""
    require_human_assets(assets)
    from benchmarks.covered_torso import PerformersAndNetworks, run

    writer = start("covered-torso", commits, narrowed=bool(only) or clock != "processor")
    run(writer, PerformersAndNetworks(assets, backbone, *landmark_models()), clock, only)


@app.command("train")
def train_command(
    commits: Commits = False,
    motion: Motion = MOTION,
    backbone: Backbone = None,
    clock: ClockName = "processor",
    only: Only = "",
) -> None:
    """How soon splats are good: from nothing, and from the same person's earlier model."""
    require_motion(motion)
    from benchmarks.training_time import run

    writer = start("train", commits, narrowed=bool(only) or clock != "processor")
    run(writer, motion, backbone, clock, only)


@app.command()
def distil(commits: Commits = False, clock: ClockName = "processor") -> None:
    """Splats learnt from a field's pictures against splats learnt from the clip's own."""
    from benchmarks.distil import run

    run(start("distil", commits, narrowed=clock != "processor"), clock)


@app.command()
def field(
    commits: Commits = False,
    preset: Annotated[str, typer.Option(help="humannerf or paper.")] = "paper",
    size: Annotated[int, typer.Option(help="Pixels a side of the view.", min=32, max=1024)] = 256,
    steps: Annotated[int, typer.Option(help="Steps that fit the field to a body.", min=50)] = 400,
) -> None:
    """What each speed-up of the paper's field is worth, with the same weights: ms and dB."""
    from benchmarks.field_speed import run

    narrowed = (preset, size, steps) != ("paper", 256, 400)
    run(start("field-speed", commits, narrowed=narrowed), preset, size, steps)


@app.command()
def kernels(commits: Commits = False) -> None:
    """The fully fused MLP against plain PyTorch on a GPU, forward and backward, 2^20 samples."""
    from benchmarks.kernels import run

    run(start("kernels", commits))


@app.command()
def expressions(commits: Commits = False, picture: Picture = None) -> None:
    """What moving splats of face and hands is worth, each expression by itself; and its time."""
    from benchmarks.expressions import run

    run(start("expressions", commits), picture)


@app.command()
def foreign(
    commits: Commits = False,
    backbone: Backbone = None,
    clock: ClockName = "processor",
    only: Only = "",
) -> None:
    """Splats of another program's exact poses, in HumanNeRF's layout, lit by the room."""
    from benchmarks.foreign.measure import run

    writer = start("foreign", commits, narrowed=bool(only) or clock != "processor")
    run(writer, backbone, clock, only)


@app.command()
def reading(commits: Commits = False) -> None:
    """Seconds that a large data set takes to be read and cut to the person."""
    from benchmarks.foreign.reading import run

    run(start("reading", commits))


@app.command()
def relight(
    commits: Commits = False,
    panoramas: Annotated[
        Path, typer.Option(help="Folder of Radiance .hdr files of rooms.")
    ] = PANORAMAS,
    picture: Picture = None,
    clock: ClockName = "processor",
) -> None:
    """Performers captured in one light and shown in another, against the truth: unlit and relit."""
    require_panoramas(panoramas)
    from benchmarks.relight import run

    writer = start("relight", commits, narrowed=clock != "processor")
    run(writer, panoramas, picture, clock)


@app.command("two-cameras")
def two_cameras_command(
    commits: Commits = False,
    footage: Annotated[Path, typer.Option(help="Folder of the two videos.")] = TWO_CAMERAS,
    picture: Picture = None,
) -> None:
    """A capture of real footage, looked at from a second camera that it never saw."""
    require_footage(footage)
    from benchmarks.two_cameras import run

    run(start("two-cameras", commits), footage, pose_model(), picture)
