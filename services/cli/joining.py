"""The command that joins a meeting: join."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scene.errors import InvalidInput
from services.cli.terminal import stop_on_interrupt

app = typer.Typer()


@app.command()
def join(
    meeting: Annotated[str, typer.Argument(help="Its link, such as http://host:8000/?meeting=ID.")],
    webcam: Annotated[Path, typer.Option(help="A video of a person, in a webcam's place.")],
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
    """Move a model in a meeting by a clip, as a page does by its webcam.

    Landmarks found in the clip leave, and its pictures stay here, but for the cut-outs of
    --live-look.
    """
    import asyncio

    from capture.detection.network_files import landmark_network_file, optional_network_file
    from services.joining.finder import PersonFinder
    from services.joining.play import ClipPlayer
    from services.joining.seat import MeetingLink, take_seat
    from services.settings import load_settings

    link, settings = MeetingLink.parse(meeting), load_settings()
    if not webcam.is_file():
        raise InvalidInput(f"--webcam must be a video; got {webcam}; check the path")
    pose = landmark_network_file(settings.pose_model_source())
    face, hand = (
        optional_network_file(source)
        for source in (settings.face_model_source(), settings.hand_model_source())
    )
    with PersonFinder(pose, face, hand) as finder, stop_on_interrupt() as should_stop:
        seat = take_seat(link, token, name, performer, live_look=live_look)
        typer.echo(f"{seat.performer_name} moves as {webcam.name} shows; Ctrl-C ends it")
        player = ClipPlayer(webcam, finder, live_look=live_look)
        played = asyncio.run(player.play(seat, loop=loop, should_stop=should_stop))
    pictures = f", {played.pictures} pictures" if live_look else ""
    typer.echo(f"{played.frames} frames looked at, {played.sent} sent{pictures}")
