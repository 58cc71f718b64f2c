"""A contact sheet of a case: what a person would look at, which decides before any mean."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from benchmarks.real.judge import TestFrame
from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.motion import Pose
from scene.sequence import body_crop

_SIDES_DEG = (30.0, -30.0, 90.0, -90.0, 180.0)
_ROWS_A_GROUP = 2
_CELL_PX = 320
_CAPTION_PX = 18
_MARGIN = 0.12
_QUALITY = 88


def draw_sheet(
    path: Path, model: PerformerModel, given: list[TestFrame], aligned: list[TestFrame]
) -> None:
    """Rows of frames; columns: the frame, the model there as given and aligned, then from 30
    and 90 degrees to either side and from behind. The person alone, over white, as viewers see
    them."""
    model = model.filmed_parts()
    rows = [_row(model, given[place], aligned[place]) for place in _chosen(given)]
    write_sheet(path, rows)


def write_sheet(path: Path, rows: list[UInt8[Array, "_ _ 3"]]) -> None:
    """Rows below one another, those that are shorter filled with white, as a JPEG."""
    width = max(row.shape[1] for row in rows)
    padded = [
        np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0)), constant_values=255)
        for row in rows
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet = np.ascontiguousarray(np.concatenate(padded)[..., ::-1])
    cv2.imwrite(str(path), sheet, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])


def _chosen(frames: list[TestFrame]) -> list[int]:
    """Some of every clip in every group, from early to late."""
    places: dict[tuple[str, str], list[int]] = {}
    for place, frame in enumerate(frames):
        places.setdefault((frame.group, frame.clip), []).append(place)
    picked = []
    for mine in places.values():
        steps = np.linspace(0, len(mine) - 1, 2 * _ROWS_A_GROUP + 1)[1::2]
        picked += [mine[place] for place in np.unique(steps.round().astype(int))]
    return picked


def _row(model: PerformerModel, given: TestFrame, aligned: TestFrame) -> UInt8[Array, "_ _ 3"]:
    crop = body_crop(given.mask, _MARGIN)
    assert crop is not None
    rows, columns = crop
    height, width = rows.stop - rows.start, columns.stop - columns.start
    camera = given.camera.cropped(columns.start, rows.start, width, height)
    truth = (given.truth + (1.0 - given.mask[..., None]))[crop]
    cells = [
        (f"{given.group.replace('_', ' ')}: {given.clip} {given.index}", truth),
        ("as given", over_white(model.render(camera, given.pose))),
        ("aligned", over_white(model.render(camera, aligned.pose))),
    ]
    for degrees in _SIDES_DEG:
        view = turned(camera, aligned.pose, model, np.radians(degrees))
        cells.append((f"{degrees:+.0f} degrees", over_white(model.render(view, aligned.pose))))
    scale = _CELL_PX / height
    size = (max(1, round(scale * width)), _CELL_PX)
    return np.concatenate([captioned(text, cell, size) for text, cell in cells], axis=1)


def turned(camera: Camera, pose: Pose, model: PerformerModel, angle_rad: float) -> Camera:
    """`camera`, carried round the vertical through the pelvis."""
    pelvis = model.skeleton.rest_joints[0] + pose.root_translation
    return camera.carried_round(pelvis, angle_rad)


def captioned(
    text: str, cell: Float[Array, "H W 3"], size: tuple[int, int]
) -> UInt8[Array, "h w 3"]:
    """`cell` at `size` (width, height) px below its `text`."""
    pixels = (255.0 * np.clip(cell, 0.0, 1.0) + 0.5).astype(np.uint8)
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    band = np.full((_CAPTION_PX, size[0], 3), 255, np.uint8)
    cv2.putText(band, text, (2, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.36, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([band, small])


def over_white(rgba: Float[Array, "H W 4"]) -> Float[Array, "H W 3"]:
    """A premultiplied picture over white."""
    return rgba[..., :3] + (1.0 - rgba[..., 3:])
