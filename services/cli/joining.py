"""The command that joins a meeting: join."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene.errors import InvalidInput
from services.cli.terminal import stop_on_interrupt

if TYPE_CHECKING:
    from services.joining.webcams import Webcam

app = typer.Typer()

_LAST_PORT = 65535


@app.command()
def join(
    meeting: Annotated[str, typer.Argument(help="Its link, such as http://host:8000/?meeting=ID.")],
    webcam: Annotated[
        Path | None, typer.Option(help="A video of a person, in a webcam's place.")
    ] = None,
    whip: Annotated[
        int | None,
        typer.Option(
            metavar="PORT",
            help="In a webcam's place, the video that a program on this device, such as OBS, "
            "sends by WHIP to http://127.0.0.1:PORT/whip.",
        ),
    ] = None,
    live_look: Annotated[
        bool,
        typer.Option(
            "--live-look",
            help="Send them cut out of it, too: the model takes its colours from there.",
        ),
    ] = False,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again, until Ctrl-C.")] = False,
    name: Annotated[str, typer.Option(help="As others in the meeting read it.")] = "Guest",
    performer: Annotated[
        str | None,
        typer.Option(help="Name or id of the model to move. [your own, or one that is lent]"),
    ] = None,
    token: Annotated[
        str | None,
        typer.Option(envvar="METANERF_TOKEN", help="Access token. [the link's, or else a guest's]"),
    ] = None,
) -> None:
    """Move a model in a meeting by a clip or a program's video, as a page does by its webcam.

    Landmarks found in it leave, and its pictures stay here, but for the cut-outs of --live-look.
    """
    import asyncio

    from capture.detection.network_files import landmark_network_file, optional_network_file
    from services.joining.finder import PersonFinder
    from services.joining.play import WebcamPlayer
    from services.joining.seat import MeetingLink, take_seat
    from services.settings import load_settings

    link, settings = MeetingLink.parse(meeting), load_settings()
    source = _webcam(webcam, whip, loop=loop)
    pose = landmark_network_file(settings.pose_model_source())
    face, hand = (
        optional_network_file(source)
        for source in (settings.face_model_source(), settings.hand_model_source())
    )
    with PersonFinder(pose, face, hand) as finder, stop_on_interrupt() as should_stop:
        seat = take_seat(link, token, name, performer, live_look=live_look)
        typer.echo(f"{seat.performer_name} moves as {source.name} shows; Ctrl-C ends it")
        player = WebcamPlayer(source, finder, live_look=live_look)
        played = asyncio.run(player.play(seat, should_stop=should_stop))
    pictures = f", {played.pictures} pictures" if live_look else ""
    typer.echo(f"{played.frames} frames looked at, {played.sent} sent{pictures}")


def _webcam(clip: Path | None, port: int | None, *, loop: bool) -> Webcam:
    from services.joining.webcams import ClipWebcam
    from services.joining.whip_webcam import WhipWebcam

    if clip is not None and port is None:
        if not clip.is_file():
            raise InvalidInput(f"--webcam must be a video; got {clip}; check the path")
        return ClipWebcam(clip, loop=loop)
    if port is None or clip is not None:
        given = "both" if clip is not None else "neither"
        raise InvalidInput(f"one of --webcam FILE and --whip PORT must be given; got {given}")
    if not 1 <= port <= _LAST_PORT:
        raise InvalidInput(
            f"--whip must be a port from 1 to {_LAST_PORT}; got {port}; choose one that is free, "
            "such as 8090"
        )
    return WhipWebcam(port, loop=loop)
