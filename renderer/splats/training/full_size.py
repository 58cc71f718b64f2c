"""Windows of the frames at the size in which they were filmed: where a step looks closely.

A step costs what its pixels do, so most steps see the whole person in a picture that is small
enough, and some a square of the frame as it was filmed. Squares lie about a splat drawn by chance:
as there are the more splats the more there is to see, they come to where detail is.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import POSITION
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import FirstSplats
from renderer.splats.training.views import View
from scene.arrays import Array, Float


def whole_views(filmed: list[View], most_px: int) -> list[View]:
    """All of `filmed` made smaller by one share, until none is larger than `most_px` a side."""
    largest = max(max(view.rgba.shape[:2]) for view in filmed)
    scale = min(1.0, most_px / largest)
    return [view.resized(scale) for view in filmed]


class FullSizeWindows:
    """Draws the windows of one training."""

    def __init__(self, filmed: list[View], first: FirstSplats, settings: SplatSettings) -> None:
        self._filmed, self._settings = filmed, settings
        self._joints, self._weights = first.joints, first.weights
        self._expressive = first.expression_splats

    def drawn(
        self,
        frame: int,
        parameters: Float[Array, "N P"],
        transforms: Float[Array, "K 4 4"],
        rng: np.random.Generator,
    ) -> View:
        """A square of `frame`, in which splats are posed by `transforms`: about one of the face or
        a hand, or about any."""
        view, settings = self._filmed[frame], self._settings
        if len(self._expressive) and rng.random() < settings.expressive_share:
            splat = int(rng.choice(self._expressive))
        else:
            splat = int(rng.integers(len(parameters)))
        blended = np.tensordot(self._weights[splat], transforms[self._joints[splat]], 1)
        rest = parameters[splat, POSITION : POSITION + 3]
        pixel, _ = view.window.project(blended[:3, :3] @ rest + blended[:3, 3])
        x, y = np.clip(pixel, -1e6, 1e6).astype(int).tolist()
        return view.cut(x, y, settings.window_px)
