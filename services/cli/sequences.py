"""Commands about sequences: capture, studio, upload."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scene.errors import InvalidInput
from services.cli.terminal import (
    print_table,
    progress_bar,
    require_writable,
    seconds,
    stop_on_interrupt,
)

app = typer.Typer()

Height = Annotated[
    float | None,
    typer.Option(
        help="Height of the person, barefoot, in metres. Without it, their size is estimated."
    ),
]


@app.command()
def capture(
    out: Annotated[Path, typer.Option(help="The sequence's folder.")],
    source: Annotated[
        Path | None, typer.Argument(help="A video, a folder or zip of frames, or a zip of videos.")
    ] = None,
    webcam: Annotated[int | None, typer.Option(help="Record with this webcam instead.")] = None,
    length: Annotated[str, typer.Option(help="How long the webcam records.")] = "15s",
    person: Annotated[
        str, typer.Option(help="Name of the person, stored with the sequence.")
    ] = "someone",
    height: Height = None,
    overlay: Annotated[
        Path | None,
        typer.Option(
            help="Write a video (.mp4) of the clip with everything that was found drawn over it."
        ),
    ] = None,
) -> None:
    """Turn a clip of one person into a sequence: masks, camera, body and motion."""
    from capture.body.model import require_height
    from capture.pipeline import CaptureOptions, capture_clip, capture_webcam
    from capture.sources.keypoints import read_keypoints
    from services.settings import load_settings

    if (source is None) == (webcam is None):
        given = "neither" if source is None else "both"
        raise InvalidInput(
            f"capture must be given a clip or --webcam; got {given}; name one of them"
        )
    if height is not None:
        require_height(height)
    require_writable(out)
    if source is not None and source.suffix.lower() == ".json":
        read_keypoints(source)
        raise InvalidInput(
            f"a sequence must be made from pictures of the person; got {source.name}, keypoints "
            "alone, which have no colours; they can drive a model (`metanerf render --motion`)"
        )
    settings = load_settings()
    options = CaptureOptions(
        person=person,
        height_m=height,
        pose_model=settings.pose_model_source(),
        face_model=settings.face_model_source(),
        hand_model=settings.hand_model_source(),
        overlay=overlay,
    )
    with stop_on_interrupt() as should_stop, progress_bar("capturing") as report:
        if webcam is not None:
            quality = capture_webcam(
                webcam,
                out,
                options,
                seconds=seconds(length),
                on_progress=report,
                should_stop=should_stop,
            )
        else:
            assert source is not None
            quality = capture_clip(
                source, out, options, on_progress=report, should_stop=should_stop
            )
    typer.echo(str(out))
    print_table(quality.rows())
    for line in quality.advice:
        typer.echo(f"  {line}")


@app.command()
def studio(
    out: Annotated[Path, typer.Option(help="The sequence's folder.")],
    performer: Annotated[
        str | None,
        typer.Option(
            help="One of amber, basil, clover, dune and ember; lifelike, with --assets: fern, "
            "flint, hazel, jasper, moss, reed, slate and thorn."
        ),
    ] = None,
    assets: Annotated[
        Path | None, typer.Option(help="MakeHuman's assets, of which lifelike performers are made.")
    ] = None,
    motion: Annotated[
        Path | None,
        typer.Option(help="Recorded motion (.bvh), or a folder with the performer's clip."),
    ] = None,
    look: Annotated[
        str,
        typer.Option(
            help="plain (flat light), lit (light of a room) or loose (clothes that swing)."
        ),
    ] = "plain",
    frames: Annotated[int, typer.Option(min=2)] = 60,
    size: Annotated[int, typer.Option(min=32, max=2048)] = 256,
    test_cameras: Annotated[int, typer.Option(min=1)] = 8,
    seed: Annotated[int, typer.Option(help="Seed of the person, without --performer.")] = 0,
    turn: Annotated[
        float, typer.Option(help="How far the person turns round, in degrees.")
    ] = 360.0,
    frame_rate: Annotated[float, typer.Option(help="Frames per second.")] = 10.0,
    footage: Annotated[
        Path | None,
        typer.Option(help="Also write the raw training frames: a video, or a folder of PNG."),
    ] = None,
    background: Annotated[
        str, typer.Option(help="Background of the footage: black or textured.")
    ] = "black",
    noise: Annotated[
        float, typer.Option(help="Noise of the footage: standard deviation in 8-bit levels.")
    ] = 0.0,
    blur: Annotated[
        float, typer.Option(help="Blur of the footage's lens: standard deviation in pixels.")
    ] = 0.0,
    shutter: Annotated[
        float,
        typer.Option(help="Exposure of the footage as a share of the frame time: motion blur."),
    ] = 0.0,
    expressions: Annotated[
        bool, typer.Option(help="The performer talks, blinks, smiles and closes their hands.")
    ] = False,
    framing: Annotated[str, typer.Option(help="body, or head (with shoulders).")] = "body",
    humannerf: Annotated[
        Path | None,
        typer.Option(help="Also write the training frames in HumanNeRF's layout to this folder."),
    ] = None,
) -> None:
    """Render a synthetic performer with exact truth: one camera and a ring of test cameras."""
    from capture.studio import Footage, make_sequence

    if footage is None and (background != "black" or noise or blur or shutter):
        raise InvalidInput(
            "background, noise, blur and shutter must come with --footage, whose pixels they "
            "change; got no --footage; add it (the sequence itself stays clean)"
        )
    require_writable(out)
    with progress_bar("filming") as report:
        make_sequence(
            out,
            performer=performer,
            assets=assets,
            motion=motion,
            look=look,
            frames=frames,
            size=size,
            test_cameras=test_cameras,
            seed=seed,
            turn_deg=turn,
            frames_per_second=frame_rate,
            footage=None if footage is None else Footage(footage, background, noise, blur, shutter),
            expressions=expressions,
            framing=framing,
            on_progress=report,
        )
    if humannerf is not None:
        from capture.sources.readers import write_humannerf
        from capture.storage import open_sequence

        write_humannerf(open_sequence(out), humannerf)
    typer.echo(str(out))


@app.command()
def upload(
    source: Annotated[
        Path, typer.Argument(help="A video, a sequence folder or keypoints (.json).")
    ],
    to: Annotated[str, typer.Option(help="Address of the service, such as http://host:8000.")],
    person: Annotated[
        str, typer.Option(help="Id or name; created if it does not exist.")
    ] = "someone",
    height: Height = None,
    token: Annotated[
        str | None,
        typer.Option(
            envvar="METANERF_TOKEN", help="Access token. Without it, a guest's is requested."
        ),
    ] = None,
) -> None:
    """Send a clip or keypoints to a service. After an interruption, run it again to continue."""
    from capture.body.model import require_height
    from capture.upload import upload as send

    if height is not None:
        require_height(height)
    if not source.exists():
        raise InvalidInput(f"source must exist; got {source}; check the path")
    with stop_on_interrupt() as should_stop, progress_bar("uploading") as report:
        sequence = send(
            source, to, person, token, height_m=height, on_progress=report, should_stop=should_stop
        )
    typer.echo(f"sequence {sequence['id']}  {sequence['state']}")
