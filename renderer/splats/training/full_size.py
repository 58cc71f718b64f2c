"""Windows of the frames at the size in which they were filmed: where a step looks closely.

A step costs what its pixels do, so most steps see the whole person in a picture that is small
enough, and some a square of the frame as it was filmed. Squares lie about a splat drawn by chance:
as there are the more splats the more there is to see, they come to where detail is.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import POSITION
from renderer.splats.settings import SplatSettings
from renderer.splats.training.trained_splats import TrainedSplats
from renderer.splats.training.views import View
from scene.arrays import Array, Float


def whole_views(filmed: list[View], most_px: int) -> list[View]:
    """All of `filmed` made smaller by one share, until none is larger than `most_px` a side."""
    largest = max(max(view.rgba.shape[:2]) for view in filmed)
    scale = min(1.0, most_px / largest)
    return [view.resized(scale) for view in filmed]


class FullSizeWindows:
    """Draws the windows of one training."""

    def __init__(self, filmed: list[View], settings: SplatSettings) -> None:
        self._filmed, self._settings = filmed, settings

    def drawn(
        self,
        frame: int,
        splats: TrainedSplats,
        transforms: Float[Array, "K 4 4"],
        rng: np.random.Generator,
    ) -> View:
        """A square of `frame`, in which `transforms` pose `splats`: about one of the face or a
        hand, or about any."""
        view, settings = self._filmed[frame], self._settings
        expressive = splats.first.expression_splats
        if len(expressive) and rng.random() < settings.expressive_share:
            splat = int(rng.choice(expressive))
        else:
            splat = int(rng.integers(len(splats)))
        blended = np.tensordot(splats.weights[splat], transforms[splats.joints[splat]], 1)
        rest = splats.parameters[splat, POSITION : POSITION + 3]
        pixel, _ = view.window.project(blended[:3, :3] @ rest + blended[:3, 3])
        x, y = np.clip(pixel, -1e6, 1e6).astype(int).tolist()
        return view.cut(x, y, settings.window_px)
