"""`metanerf bench`: what the pages claim, measured again on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks import cli_parsimony
from benchmarks.cli_options import (
    Assets,
    Backbone,
    ClockName,
    Commits,
    Footage,
    LpipsBackbone,
    Motion,
    Only,
    Picture,
    landmark_models,
    pose_model,
    start,
)
from benchmarks.cli_real import levels, live_look, real
from benchmarks.cli_service import faults, load
from benchmarks.cli_stability import stability
from benchmarks.inputs import (
    FOOTAGE,
    HUMAN_ASSETS,
    LPIPS_BACKBONE,
    MOTION,
    PANORAMAS,
    TWO_CAMERAS,
    WEBCAM,
    require_browser,
    require_footage,
    require_human_assets,
    require_motion,
    require_panoramas,
    require_real_footage,
    require_webcam_clip,
)
from services.cli.terminal import seconds

app = typer.Typer(
    help="Measure what is claimed, on this machine. Figures go to build/figures.",
    no_args_is_help=True,
)
app.registered_commands += cli_parsimony.app.registered_commands

app.command()(stability)

_CLIPS = 10


app.command("real")(real)
app.command("live-look")(live_look)
app.command()(levels)
app.command()(load)
app.command()(faults)


@app.command("all")
def run_all(
    names: Annotated[
        list[str] | None, typer.Argument(help="Files of docs/figures without .json; none: all.")
    ] = None,
    commits: Commits = False,
    backbone: Backbone = None,
) -> None:
    """Everything that this commit has no figures of; a run that was cut goes on."""
    from benchmarks import run_all as runner
    from benchmarks.pages.blocks import write_pages
    from benchmarks.reporting.checkout import Checkout

    checkout = Checkout()
    well = runner.run_all(
        runner.chosen(names or ()),
        None if backbone is None else backbone.resolve(),
        commits=commits,
        checkout=checkout,
        measure=runner.in_process_of_its_own(checkout),
    )
    if commits:
        write_pages(checkout.root)
    raise typer.Exit(0 if well else 1)


@app.command()
def pages() -> None:
    """Tables and charts of the pages, made anew from docs/figures."""
    from benchmarks.pages.blocks import write_pages
    from benchmarks.reporting.checkout import ROOT

    for path in write_pages(ROOT):
        typer.echo(path)


@app.command()
def serve(commits: Commits = False) -> None:
    """A live view: ms from pose to picture, then frames a second in a browser, and the cost."""
    require_browser()
    from benchmarks.serve import run

    run(start("serve", commits))


@app.command()
def enrolment(
    commits: Commits = False,
    clip: Annotated[
        list[Path] | None, typer.Option(help="A video of one person; repeat for several.")
    ] = None,
) -> None:
    """How soon somebody who has sent a clip is met."""
    clips = clip or [WEBCAM]
    for one in clips:
        require_webcam_clip(one)
    from benchmarks.enrolment import run

    run(start("enrolment", commits, narrowed=clip is not None), clips)


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
def meeting(
    commits: Commits = False,
    clip: Annotated[
        Path, typer.Option(help="Video of one person, which a page's camera shows.")
    ] = WEBCAM,
) -> None:
    """Landmarks to picture: latency, bytes, frames a second, cost; and the time to find them."""
    require_webcam_clip(clip)
    require_browser()
    from benchmarks.meeting import run

    run(start("meeting", commits), clip, pose_model())


@app.command()
def lipsync(commits: Commits = False) -> None:
    """How far apart lips are seen and a voice is heard: on a page, live and recorded."""
    require_browser()
    from benchmarks.lipsync.measure import run

    run(start("lipsync", commits))


@app.command("local-view")
def local_view(commits: Commits = False) -> None:
    """The page's own drawing in a browser without a graphics card: processor ms a picture."""
    require_browser()
    from benchmarks.local_view import run

    run(start("local-view", commits))


@app.command("local-look")
def local_look(commits: Commits = False) -> None:
    """What live look costs a page that draws by itself: pictures a second, and bytes."""
    require_browser()
    from benchmarks.local_look import run

    run(start("local-look", commits))


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
    from benchmarks.covered_torso import run

    writer = start("covered-torso", commits, narrowed=bool(only) or clock != "processor")
    run(writer, assets, backbone, clock, only)


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


@app.command("capture")
def capture_command(
    commits: Commits = False,
    motion: Motion = MOTION,
    backbone: Backbone = None,
    clips: Annotated[int, typer.Option(help="How many of them, by name.", min=1)] = _CLIPS,
    clock: ClockName = "processor",
    only: Only = "",
) -> None:
    """Captures of studio performers from pixels alone against the truth, stage by stage."""
    require_motion(motion)
    from benchmarks.capture import run

    narrowed = bool(only) or clips != _CLIPS or clock != "processor"
    writer = start("capture", commits, narrowed=narrowed)
    run(writer, motion, pose_model(), backbone, clips, clock, only)


@app.command("live-capture")
def live_capture(
    commits: Commits = False,
    clip: Annotated[
        Path | None, typer.Option(help="A video instead of studio footage; without truth.")
    ] = None,
) -> None:
    """The live pose solver: ms a frame, and joints against the clip-wide fit and the truth."""
    require_browser()
    from benchmarks.live_capture import run

    run(start("live-capture", commits, narrowed=clip is not None), clip)


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


@app.command()
def masks(
    commits: Commits = False,
    motion: Motion = MOTION,
    assets: Assets = HUMAN_ASSETS,
    footage: Footage = FOOTAGE,
) -> None:
    """Captured masks and edge colours, stage by stage: painted, lifelike and real people."""
    require_motion(motion)
    require_real_footage(footage)
    from benchmarks.masks import run

    run(start("masks", commits), motion, assets, footage)


@app.command("expressions-found")
def expressions_found(commits: Commits = False, assets: Assets = HUMAN_ASSETS) -> None:
    """Gaze, faces and fingers, found from pictures of lifelike performers who know them."""
    require_human_assets(assets)
    from benchmarks.expressions_found import run

    _, face, hand = landmark_models()
    run(start("expressions-found", commits), assets, face, hand)


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
