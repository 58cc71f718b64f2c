"""Live look beside the model alone, at the webcam's place and from beside it."""

from __future__ import annotations

from collections.abc import Sequence as Many
from pathlib import Path
from typing import Protocol

import numpy as np

from benchmarks.real.judge import TestFrame
from benchmarks.real.sheet import captioned, over_white, turned, write_sheet
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.arrays import Array, UInt8
from scene.live_appearance import LiveAppearance
from scene.sequence import body_crop

_SIDES_DEG = (0.0, 20.0, 45.0, 90.0)
_ROWS = 5
_CELL_PX, _MARGIN = 300, 0.12


class ShownFrame(Protocol):
    """A judged frame and what live look makes of it."""

    @property
    def frame(self) -> TestFrame: ...
    @property
    def appearance(self) -> LiveAppearance: ...


def draw_sheet(path: Path, model: SplatModel, shown: Many[ShownFrame]) -> None:
    """Rows of frames; columns: the frame, then from 0, 20, 45 and 90 degrees beside its camera
    without and with live look. Parts never filmed fade out, as viewers see them."""
    renderer = SplatRenderer((model.filmed_parts(),))
    places = np.unique(np.linspace(0, len(shown) - 1, _ROWS).round().astype(int))
    write_sheet(path, [_row(renderer, model, shown[place]) for place in places])


def _row(renderer: SplatRenderer, model: SplatModel, one: ShownFrame) -> UInt8[Array, "_ _ 3"]:
    frame, pose = one.frame, one.frame.pose
    crop = body_crop(frame.mask, _MARGIN)
    assert crop is not None
    rows, columns = crop
    height, width = rows.stop - rows.start, columns.stop - columns.start
    camera = frame.camera.cropped(columns.start, rows.start, width, height)
    transforms = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    truth = (frame.truth + (1.0 - frame.mask[..., None]))[crop]
    cells = [(f"{frame.clip} {frame.index}", truth)]
    for degrees in _SIDES_DEG:
        view = turned(camera, pose, model, np.radians(degrees))
        for name, appearance in (("model", None), ("live look", one.appearance)):
            picture = renderer.render(
                view, [transforms], expressions=[pose.expression], appearances=[appearance]
            )
            cells.append((f"{degrees:.0f} degrees: {name}", over_white(picture)))
    size = (max(1, round(_CELL_PX * width / height)), _CELL_PX)
    return np.concatenate([captioned(text, cell, size) for text, cell in cells], axis=1)
