"""`metanerf bench`: what the pages claim, measured again on this machine."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import typer

from scene.errors import InvalidInput
from services.cli.terminal import seconds

app = typer.Typer(help="Measure what is claimed, on this machine.", no_args_is_help=True)

MOTION = Path("../shared/data/mocap")
TWO_CAMERAS = Path("../shared/data/real-two-cameras")
WEBCAM = Path("../shared/data/real-monocular/webcam_upperbody_woman_asl.mp4")
PANORAMAS = Path("../shared/data/environments")
"""Data beside the checkout; no part of this package."""
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the figures here.")]
Backbone = Annotated[Path | None, typer.Option(help="LPIPS backbone (.pth).")]
State = Annotated[
    Path, typer.Option(help="Folder that keeps each finished measurement: a cut run goes on there.")
]
ClockName = Annotated[
    Literal["wall", "processor"],
    typer.Option(help="Seconds on all cores, or one thread's own where the machine is busy."),
]
Only = Annotated[str, typer.Option(help="Measure only what has this in its name; none: nothing.")]


def require_motion(folder: Path) -> None:
    """Raises InvalidInput where there is no recorded motion."""
    if not any(folder.glob("*.bvh")):
        raise InvalidInput(
            f"motion must be a folder with .bvh files; got {folder}; see docs/data.md for clips"
        )


@app.command()
def serve(json_file: JsonFile = None) -> None:
    """A live view: ms from pose to picture, then frames a second in a browser, and the cost."""
    if find_spec("playwright") is None:  # only tests and this need a browser
        raise InvalidInput(
            "a browser must be at hand to watch the meeting; got no package playwright; "
            "run `make setup-test`"
        )
    from benchmarks.serve import run

    run(json_file)


@app.command()
def gpu(
    json_file: JsonFile = None,
    page: Annotated[
        Path | None, typer.Option(help="Markdown page whose tables are made anew.")
    ] = None,
    train_for: Annotated[
        list[str], typer.Option(help="Train the paper's field too, for so long; may be repeated.")
    ] = [],  # noqa: B006 (nobody changes it)
) -> None:
    """What a CUDA device brings: splats, beside gsplat where it is installed, and the field."""
    from benchmarks.gpu import run

    run(json_file, page, [seconds(one) for one in train_for])


@app.command()
def meeting(
    json_file: JsonFile = None,
    clip: Annotated[
        Path, typer.Option(help="Film of one person, which a page's camera shows.")
    ] = WEBCAM,
) -> None:
    """Landmarks to picture: latency, bytes, frames a second, cost; and the time to find them."""
    if not clip.is_file():
        raise InvalidInput(f"clip must be a film of one person; got {clip}; name one by --clip")
    if find_spec("playwright") is None:
        raise InvalidInput(
            "a browser must be at hand to watch the meeting; got no package playwright; "
            "run `make setup-test`"
        )
    from benchmarks.meeting import run
    from capture.detection.network_files import landmark_network_file
    from services.settings import load_settings

    run(json_file, clip, landmark_network_file(load_settings().pose_model_source()))


@app.command("local-view")
def local_view(json_file: JsonFile = None) -> None:
    """The page's own drawing in a browser without a graphics card: processor ms a picture."""
    if find_spec("playwright") is None:
        raise InvalidInput(
            "a browser must be at hand to draw in; got no package playwright; run `make setup-test`"
        )
    from benchmarks.local_view import run

    run(json_file)


@app.command()
def frontier(
    state: State = Path("frontier"),
    json_file: JsonFile = None,
    page: Annotated[
        Path | None, typer.Option(help="Markdown page whose tables are made anew.")
    ] = None,
    backbone: Backbone = None,
    scaled: Annotated[
        str, typer.Option(help="Time of one thread for each of the paper's presets' scaled runs.")
    ] = "60m",
    clock: ClockName = "wall",
    only: Only = "",
) -> None:
    """Speed against accuracy of all presets on one sequence: charts, tables, the Pareto front."""
    from benchmarks.frontier.measure import run

    run(json_file, page, state, backbone, seconds(scaled), clock, only)


@app.command()
def cast(
    state: State = Path("cast"),
    json_file: JsonFile = None,
    page: Annotated[
        Path | None, typer.Option(help="Markdown page whose table is made anew.")
    ] = None,
    motion: Annotated[Path, typer.Option(help="Folder of recorded motion (.bvh).")] = MOTION,
    backbone: Backbone = None,
    clock: ClockName = "wall",
    only: Only = "",
) -> None:
    """Accuracy on the five studio performers in real motion, in every look."""
    require_motion(motion)
    from benchmarks.performers import run

    run(json_file, page, state, motion, backbone, clock, only)


@app.command("train")
def train_command(
    state: State = Path("ready"),
    json_file: JsonFile = None,
    motion: Annotated[Path, typer.Option(help="Folder of recorded motion (.bvh).")] = MOTION,
    backbone: Backbone = None,
    clock: ClockName = "wall",
    only: Only = "",
) -> None:
    """How soon splats are good: from nothing, and from the same person's earlier model."""
    require_motion(motion)
    from benchmarks.training_time import run

    run(json_file, state, motion, backbone, clock, only)


@app.command()
def distil(json_file: JsonFile = None, clock: ClockName = "wall") -> None:
    """Splats learnt from a field's pictures against splats learnt from the clip's own."""
    from benchmarks.distil import run

    run(json_file, clock)


@app.command()
def field(
    json_file: JsonFile = None,
    preset: Annotated[str, typer.Option(help="humannerf or paper.")] = "paper",
    size: Annotated[int, typer.Option(help="Pixels a side of the view.", min=32, max=1024)] = 256,
    steps: Annotated[int, typer.Option(help="Steps that fit the field to a body.", min=50)] = 400,
) -> None:
    """What each speed-up of the paper's field is worth, with the same weights: ms and dB."""
    from benchmarks.field_speed import run

    run(json_file, preset, size, steps)


@app.command()
def kernels(json_file: JsonFile = None) -> None:
    """The fully fused MLP against plain PyTorch on a GPU, forward and backward, 2^20 samples."""
    from benchmarks.kernels import run

    run(json_file)


@app.command("capture")
def capture_command(
    json_file: JsonFile = None,
    motion: Annotated[Path, typer.Option(help="Folder of recorded motion (.bvh).")] = MOTION,
    backbone: Backbone = None,
    clips: Annotated[int, typer.Option(help="How many of them, by name.", min=1)] = 10,
    robustness: Annotated[
        bool, typer.Option("--robustness", help="One clip, spoilt in many ways, instead.")
    ] = False,
    state: State = Path("captures"),
    clock: ClockName = "wall",
    only: Only = "",
) -> None:
    """Captures of studio performers from pixels alone against the truth, stage by stage."""
    require_motion(motion)
    from benchmarks import capture, capture_robustness
    from capture.detection.network_files import landmark_network_file
    from services.settings import load_settings

    model_file = landmark_network_file(load_settings().pose_model_source())
    if robustness:
        capture_robustness.run(json_file, motion, model_file)
    else:
        capture.run(json_file, motion, model_file, backbone, clips, state, clock, only)


@app.command("live-capture")
def live_capture(
    json_file: JsonFile = None,
    clip: Annotated[
        Path | None, typer.Option(help="A video instead of studio footage; without truth.")
    ] = None,
) -> None:
    """The live pose solver: ms a frame, and joints against the clip-wide fit and the truth."""
    from benchmarks.live_capture import run

    run(json_file, clip)


@app.command()
def expressions(
    json_file: JsonFile = None,
    picture: Annotated[Path | None, typer.Option(help="Draw the faces here.")] = None,
) -> None:
    """What moving splats of face and hands is worth, each expression by itself; and its time."""
    from benchmarks.expressions import run

    run(json_file, picture)


@app.command()
def refinement(json_file: JsonFile = None, clock: ClockName = "wall") -> None:
    """Noise on every joint, and what refining poses wins back: splats, and the paper's MLP."""
    from benchmarks.refinement import run

    run(json_file, clock)


@app.command()
def relight(
    json_file: JsonFile = None,
    panoramas: Annotated[
        Path, typer.Option(help="Folder of Radiance .hdr files of rooms.")
    ] = PANORAMAS,
    picture: Annotated[Path | None, typer.Option(help="Draw the comparison here.")] = None,
    clock: ClockName = "wall",
) -> None:
    """Performers filmed in one light and shown in another, against the truth: unlit and relit."""
    from benchmarks.relight import run

    run(json_file, panoramas, picture, clock)


@app.command()
def masks(json_file: JsonFile = None) -> None:
    """Captured masks and edge colours against the studio's exact ones, stage by stage."""
    from benchmarks.masks import run

    run(json_file)


@app.command("two-cameras")
def two_cameras_command(
    json_file: JsonFile = None,
    footage: Annotated[Path, typer.Option(help="Folder of the two films.")] = TWO_CAMERAS,
    picture: Annotated[Path | None, typer.Option(help="Draw the comparison here.")] = None,
) -> None:
    """A capture of real footage, looked at from a second camera that it never saw."""
    if not (footage / "cam02.mp4").exists():
        raise InvalidInput(
            f"footage must hold cam01.mp4, cam02.mp4 and Calib.qca.txt; got {footage}; they are "
            "Demo_SinglePerson of Pose2Sim"
        )
    from benchmarks.two_cameras import run
    from capture.detection.network_files import landmark_network_file
    from services.settings import load_settings

    run(json_file, footage, landmark_network_file(load_settings().pose_model_source()), picture)
