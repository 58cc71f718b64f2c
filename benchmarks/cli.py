"""`metanerf bench`: what the pages claim, measured again on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks import cli_models, cli_parsimony
from benchmarks.cli_options import (
    Assets,
    Backbone,
    ClockName,
    Commits,
    Footage,
    Motion,
    Only,
    landmark_models,
    pose_model,
    start,
)
from benchmarks.cli_real import levels, live_head, live_look, real
from benchmarks.cli_service import faults, load, renderers
from benchmarks.cli_stability import paper_stability, stability
from benchmarks.inputs import (
    FOOTAGE,
    HUMAN_ASSETS,
    MOTION,
    WEBCAM,
    require_browser,
    require_human_assets,
    require_motion,
    require_real_footage,
    require_webcam_clip,
)

app = typer.Typer(
    help="Measure what is claimed, on this machine. Figures go to build/figures.",
    no_args_is_help=True,
)
app.registered_commands += cli_models.app.registered_commands
app.registered_commands += cli_parsimony.app.registered_commands
app.command()(stability)
app.command("paper-stability")(paper_stability)
app.command("real")(real)
app.command("live-look")(live_look)
app.command("live-head")(live_head)
app.command()(levels)
app.command()(load)
app.command()(faults)
app.command()(renderers)

_CLIPS = 10


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
def local_look(
    commits: Commits = False,
    clip: Annotated[
        Path, typer.Option(help="Video of one person, which the sender's camera shows.")
    ] = WEBCAM,
) -> None:
    """What live look costs pages: pictures a second and bytes of one that draws by itself, and
    processor time of its sender's; and how soon it is gone once it is switched off."""
    require_webcam_clip(clip)
    require_browser()
    from benchmarks.local_look import run

    run(start("local-look", commits, narrowed=clip != WEBCAM), clip)


@app.command("look-cost")
def look_cost(commits: Commits = False) -> None:
    """What live look costs the server, and the line up."""
    from benchmarks.look_cost import run

    run(start("look-cost", commits))


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
