"""Pictures and videos on disk, each whole or not at all."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np

from capture.overlay import write_video
from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float, UInt8
from scene.errors import InvalidInput
from scene.motion import Motion
from services.live.room import ping_pong_pose
from services.person_view import person_camera
from services.synthetic import VIDEO_METADATA, mark_picture

FRAMES_PER_SECOND = 30
BACKDROP = (0.93, 0.93, 0.93)
"""sRGB behind a person who is shown alone."""
_SIDES = {"front": 0.0, "left": 90.0, "back": 180.0, "right": -90.0}
_FIELD_OF_VIEW_RAD = 0.6


def camera_path(
    model: PerformerModel,
    motion: Motion,
    camera: str,
    size: int,
    distance_m: float | None,
    start_s: float,
    length_s: float,
) -> Iterator[UInt8[Array, "H W 3"]]:
    """Pictures of a path: `orbit` goes round once; a side, or `AZIMUTH,ELEVATION`, stands still.

    Sides are counted as `services.person_view` says.
    Raises InvalidInput for a camera that is none of these.
    """
    azimuth_deg, elevation_deg, turns = _parse_camera(camera)
    count = max(1, round(length_s * FRAMES_PER_SECOND))
    middle = motion.pose_at(start_s + float(motion.times_s[0]))
    for frame in range(count):
        pose = ping_pong_pose(motion, start_s + frame / FRAMES_PER_SECOND)
        view = person_camera(
            model.skeleton,
            motion,
            middle,
            azimuth_deg=azimuth_deg + turns * 360.0 * frame / count,
            elevation_deg=elevation_deg,
            distance_m=distance_m,
            width=size,
            height=size,
            fov_y_rad=_FIELD_OF_VIEW_RAD,
        )
        yield over_backdrop(model.filmed_parts().render(view, pose))


def over_backdrop(
    rgba: Float[Array, "H W 4"], backdrop: tuple[float, float, float] = BACKDROP
) -> UInt8[Array, "H W 3"]:
    """sRGB bytes of a premultiplied picture over a plain colour."""
    shown = rgba[..., :3] + (1.0 - rgba[..., 3:]) * np.array(backdrop, np.float32)
    return (np.clip(shown, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def write_png(path: Path, picture: UInt8[Array, "H W 3"]) -> None:
    """Write one picture, marked as synthetic."""
    _, data = cv2.imencode(".png", picture[..., ::-1])
    height, width = picture.shape[:2]
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(mark_picture(data.tobytes(), width, height))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_mp4(path: Path, pictures: Iterable[UInt8[Array, "H W 3"]]) -> None:
    """Write an H.264 MP4 of 30 frames/s, marked as synthetic."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.stem}.part.mp4")
    try:
        write_video(pictures, part, FRAMES_PER_SECOND, VIDEO_METADATA)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _parse_camera(camera: str) -> tuple[float, float, float]:
    """Azimuth and elevation (degrees), and how often the camera goes round."""
    if camera == "orbit":
        return 0.0, 5.0, 1.0
    if camera in _SIDES:
        return _SIDES[camera], 5.0, 0.0
    try:
        azimuth_deg, elevation_deg = (float(part) for part in camera.split(","))
    except ValueError:
        azimuth_deg = elevation_deg = math.nan
    if not (math.isfinite(azimuth_deg) and -90.0 < elevation_deg < 90.0):
        raise InvalidInput(
            f"camera must be orbit, {', '.join(_SIDES)} or AZIMUTH,ELEVATION in degrees, "
            f"the latter between -90 and 90; got {camera!r}"
        )
    return azimuth_deg, elevation_deg, 0.0
