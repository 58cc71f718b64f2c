"""Options that benchmarks share, and what each begins with."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from scene.errors import InvalidInput

if TYPE_CHECKING:
    from benchmarks.reporting.figures import FigureWriter

Commits = Annotated[
    bool,
    typer.Option(
        "--commit-figures",
        help="Write docs/figures too, which the pages show; the tree must have no changes.",
    ),
]
Motion = Annotated[Path, typer.Option(help="Folder of recorded motion (.bvh).")]
Assets = Annotated[
    Path, typer.Option(help="MakeHuman's assets; without them no lifelike performers.")
]
Footage = Annotated[Path, typer.Option(help="Folder of the folders real-*.")]
Backbone = Annotated[Path | None, typer.Option(help="LPIPS backbone (.pth).")]
LpipsBackbone = Annotated[Path, typer.Option(help="LPIPS backbone (.pth).")]
Picture = Annotated[Path | None, typer.Option(help="Draw the comparison here.")]
ClockName = Annotated[
    Literal["wall", "processor"],
    typer.Option(help="Seconds on all cores, or one thread's own, which neighbours change little."),
]
Only = Annotated[str, typer.Option(help="Measure only what has this in its name; none: nothing.")]


def start(name: str, commits: bool, *, narrowed: bool = False) -> FigureWriter:
    """The file that the figures of `name` go to.

    Raises InvalidInput where they are to be committed, and are of less than the whole benchmark or
    of a tree with changes.
    """
    from benchmarks.reporting.figures import FigureWriter, command_line

    if commits and narrowed:
        raise InvalidInput(
            "committed figures must be of the whole benchmark as the pages describe it; got "
            f"`{command_line(sys.argv[1:])}`; leave out the options that change what is measured"
        )
    return FigureWriter.start(name, commits=commits)


def pose_model() -> Path:
    """Of bodies, from this machine or fetched."""
    from capture.detection.network_files import landmark_network_file
    from services.settings import load_settings

    return landmark_network_file(load_settings().pose_model_source())


def landmark_models() -> tuple[Path, Path, Path]:
    """Of bodies, faces and hands."""
    from capture.detection.network_files import landmark_network_file
    from services.settings import load_settings

    own = load_settings()
    face, hand = own.face_model_source(), own.hand_model_source()
    return pose_model(), landmark_network_file(face), landmark_network_file(hand)
