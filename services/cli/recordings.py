"""Commands about recorded meetings."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from scene.errors import InvalidInput
from services.cli.terminal import progress_bar, require_writable

app = typer.Typer()


@app.command("export-recording")
def export_recording(
    recording: Annotated[str, typer.Argument(help="The recording's id.")],
    out: Annotated[Path, typer.Option(help="The video's file (.mp4).")],
    path: Annotated[
        Path | None,
        typer.Option(
            help='Path of the camera as JSON: [{"at_s": 0, "position": [0, 1.5, 3], '
            '"target": [0, 1, 0]}]. [once around everybody]'
        ),
    ] = None,
    width: Annotated[int, typer.Option(help="Width, in pixels.", min=64, max=1920)] = 1280,
    height: Annotated[int, typer.Option(help="Height, in pixels.", min=64, max=1088)] = 720,
    fov: Annotated[float, typer.Option(help="Vertical field of view, in degrees.")] = 35.0,
    data_dir: Annotated[Path | None, typer.Option(help="The server's data folder.")] = None,
) -> None:
    """Make a video of a recorded meeting, on the machine that stores it."""
    from services.composition import build_services
    from services.recording.replay import load
    from services.recording.video_export import CameraPath, export_video
    from services.settings import load_settings

    require_writable(out)
    if width % 2 or height % 2:
        raise InvalidInput(
            f"width and height must be even; got {width} x {height}; add or remove a pixel"
        )
    settings = load_settings(**({} if data_dir is None else {"data_dir": data_dir}))
    services = build_services(settings)
    try:
        services.database.migrate()  # a folder in which no server ran has no recordings
        recorded = load(services, recording)
        camera_path = CameraPath(_keyframes(path), width, height, math.radians(fov))
        with progress_bar("filming") as report:
            export_video(recorded, camera_path, out, lambda fraction: report(fraction, "filming"))
    finally:
        services.close()
    typer.echo(f"{out}  {recorded.duration_s:.1f} s  {out.stat().st_size / 1e6:.2f} MB")


def _keyframes(path: Path | None):
    from services.recording.video_export import CameraKeyframe

    if path is None:
        return []
    try:
        return [
            CameraKeyframe(float(one["at_s"]), tuple(one["position"]), tuple(one["target"]))
            for one in json.loads(path.read_text())
        ]
    except (ValueError, KeyError, TypeError) as error:
        raise InvalidInput(
            f"a camera path must be a JSON list of at_s, position and target; got {path}: {error}"
        ) from error
