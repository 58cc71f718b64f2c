"""Live look beside the model alone and the truth, from beside a lifelike performer's webcam."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.lifelike_look.performances import Performance, beside
from benchmarks.real.sheet import captioned, write_sheet
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.arrays import Array, Float, UInt8
from scene.camera import Camera
from scene.live_appearance import LiveAppearance
from scene.motion import Pose
from scene.sequence import body_crop

Shown = Literal["off", "model", "live"]
"""Without live look; the model alone in the pose that live look aligned; with live look."""
_SIDES_DEG = (0.0, 20.0, 45.0, 90.0)
_ROWS = 2
_CELL_PX, _MARGIN = 260, 0.08


@dataclass(frozen=True, eq=False)
class LookedAt:
    """What live look makes of one moment of a performance."""

    performance: Performance
    number: int
    """Of the performance's pose."""
    camera: Camera
    """Of the webcam's whole picture, in the world of the poses."""
    solved: Pose
    """From the landmarks, as it is shown without live look."""
    pose: Pose
    """Aligned with the picture."""
    appearance: LiveAppearance

    def rendered(
        self, renderer: SplatRenderer, model: SplatModel, degrees: float, shown: Shown
    ) -> Float[Array, "H W 3"]:
        """The model from beside the webcam, over black."""
        pose = self.solved if shown == "off" else self.pose
        view = beside(self.camera, pose, model.skeleton, degrees)
        transforms = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
        picture = renderer.render(
            view,
            [transforms],
            expressions=[pose.expression],
            appearances=[self.appearance if shown == "live" else None],
        )
        return np.clip(picture[..., :3], 0.0, 1.0)


def draw_sheet(path: Path, model: SplatModel, performances: Iterable[list[LookedAt]]) -> None:
    """Rows of moments; from each side the truth, the model alone, and with live look."""
    renderer, rows = SplatRenderer((model,)), []
    for shown in performances:
        places = np.linspace(0, len(shown) - 1, _ROWS + 2)[1:-1].round().astype(int)
        rows += [_row(renderer, model, shown[place]) for place in places]
    write_sheet(path, rows)


def _row(renderer: SplatRenderer, model: SplatModel, one: LookedAt) -> UInt8[Array, "_ _ 3"]:
    cells = []
    for degrees in _SIDES_DEG:
        truth = one.performance.truth(one.number, degrees)
        crop = body_crop(truth.mask, _MARGIN)
        assert crop is not None
        rows, columns = crop
        height, width = rows.stop - rows.start, columns.stop - columns.start
        size = (max(1, round(_CELL_PX * width / height)), _CELL_PX)
        for name, picture in (
            ("truth", truth.image),
            ("model", one.rendered(renderer, model, degrees, "model")),
            ("live look", one.rendered(renderer, model, degrees, "live")),
        ):
            cells.append(captioned(f"{degrees:.0f} degrees: {name}", picture[crop], size))
    return np.concatenate(cells, axis=1)
