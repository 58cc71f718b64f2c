"""Schedule of pose refinement during the training of splats, and the equations of each pass.

Pictures are rendered at full size, as in training, and downscaled with the frames: rendered at a
small size, splats thinner than a pixel would cover too much of it and push every body away from the
camera. So did blurring them at the start of a training.
"""

from __future__ import annotations

import numpy as np

from renderer.pose_refinement.bundle_adjustment import ClipNormalEquations
from renderer.pose_refinement.clip_poses import PoseRefinement
from renderer.pose_refinement.photometry import (
    POSE_PARAMETERS,
    SHARED_PARAMETERS,
    SkinnedPoints,
    normal_equations,
)
from renderer.splats.expressions import ClipBlendShapes
from renderer.splats.layout import BOX_FILTER_PX2
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.training.views import View
from scene.arrays import Array, Float, Int, UInt8
from scene.camera import Camera

_HEIGHTS_PX = (48.0, 96.0, 192.0)
"""Height of the person in the compared pictures, from the first passes to the last."""
_FIRST, _LAST = 0.15, 0.8
"""Shares of the training between which passes run: after the splats have the person's colours, and
early enough for them to become as sharp as the poses allow."""
_MAX_PASSES = 10
"""Passes of a training at most."""
_INITIAL_EPOCHS, _EPOCHS = 6, 1
"""Epochs before the first pass, and between two: splats that have not converged would shift the
poses. Short trainings therefore have fewer passes."""


class RefinementPasses:
    """The passes of one training; with `colours_known`, of an earlier model, they begin at once."""

    def __init__(self, views: list[View], *, colours_known: bool = False) -> None:
        self._views, self._colours_known = views, colours_known
        self._steps = self._done = 0
        heights = [np.flatnonzero((view.rgba[..., 3] > 127).any(axis=1)).size for view in views]
        self._shares = [max(1, round(float(np.median(heights)) / height)) for height in _HEIGHTS_PX]
        self._levels: dict[int, list[tuple[Float[Array, "h w 4"], Camera]]] = {}
        self._work = Workspace(0)

    def should_run(self, fraction: float) -> bool:
        """Whether a pass runs now; called once a step."""
        self._steps += 1
        epochs = _EPOCHS if self._done or self._colours_known else _INITIAL_EPOCHS
        first = 0.0 if self._colours_known else _FIRST
        planned = first + (_LAST - first) * self._done / _MAX_PASSES
        run = planned <= fraction < _LAST and self._steps >= epochs * len(self._views)
        if run:
            self._steps, self._done = 0, self._done + 1
        return run

    def equations(
        self,
        points: SkinnedPoints,
        parameters: Float[Array, "N P"],
        poses: PoseRefinement,
        fraction: float,
        expressions: ClipBlendShapes,
    ) -> ClipNormalEquations:
        """Normal equations of all frames, with each frame's expression applied to the splats."""
        if len(self._work.projected) != len(parameters):
            self._work = Workspace(len(parameters))
        level = min(int(len(_HEIGHTS_PX) * fraction / _LAST), len(_HEIGHTS_PX) - 1)
        frames, size = len(self._views), POSE_PARAMETERS + SHARED_PARAMETERS
        matrices, vectors = np.zeros((frames, size, size)), np.zeros((frames, size))
        cost, pixels = 0.0, 0.0
        for frame, (truth, camera) in enumerate(self._level(level)):
            shown = expressions.moved(parameters, frame)
            picture = self._render(frame, shown, points, poses)
            made = _box_filtered(picture, truth.shape[:2])
            front = self._front_in_middles(picture.shape[:2], truth.shape[:2])
            frame_equations = normal_equations(
                made, truth, front, points, poses.skeleton, camera, poses.pose(frame), shared=True
            )
            matrices[frame], vectors[frame] = frame_equations.matrix, frame_equations.vector
            cost, pixels = cost + frame_equations.cost, pixels + float(truth[..., 3].sum())
        return ClipNormalEquations(matrices, vectors, cost / max(pixels, 1.0))

    def end(self) -> None:
        """No more passes."""
        self._done = _MAX_PASSES

    def state(self) -> dict[str, Array]:
        """What `restore` needs."""
        return {"passes": np.array([self._steps, self._done])}

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        self._steps, self._done = (int(count) for count in state["passes"])

    def _level(self, level: int) -> list[tuple[Float[Array, "h w 4"], Camera]]:
        """Frames and their cameras in the size of one level: short trainings ask for few."""
        if level not in self._levels:
            share = self._shares[level]
            self._levels[level] = [_downscaled(view, share) for view in self._views]
        return self._levels[level]

    def _render(
        self, frame: int, parameters: Array, points: SkinnedPoints, poses: PoseRefinement
    ) -> Float[Array, "H W 4"]:
        """The whole picture of `frame`, premultiplied."""
        import numba

        from renderer.splats.rasteriser.tile_kernels import draw

        view, work = self._views[frame], self._work
        height, width = view.rgba.shape[:2]
        work.arrange(
            parameters,
            points.joints,
            points.weights,
            poses.transforms(frame),
            view.camera,
            width,
            height,
            BOX_FILTER_PX2,
        )
        picture = np.empty((height, width, 4), np.float32)
        draw(work.projected, work.starts, work.entries, numba.get_num_threads(), picture)
        return picture

    def _front_in_middles(self, whole: tuple[int, ...], size: tuple[int, ...]) -> Int[Array, "h w"]:
        """Which splat the picture just rendered, of size `whole`, shows in the middle of each pixel
        of a picture of `size`."""
        share = whole[0] // size[0]
        rows, columns = share * np.indices(size).reshape(2, -1) + share // 2
        return self._work.front_of_pixels(rows, columns, whole[1]).reshape(size)


def _downscaled(view: View, share: int) -> tuple[Float[Array, "h w 4"], Camera]:
    """A frame and its camera at 1/`share` of the size; the remainder at the right and below is
    cropped."""
    height, width = (side // share for side in view.rgba.shape[:2])
    picture = _box_filtered(view.rgba, (height, width)) / np.float32(255.0)
    return picture, view.window.cropped(0, 0, width * share, height * share).resized(width, height)


def _box_filtered(
    picture: Float[Array, "H W 4"] | UInt8[Array, "H W 4"], size: tuple[int, ...]
) -> Float[Array, "h w 4"]:
    """Box-filtered to `size`, an integer fraction of its own but for a cropped remainder."""
    height, width = size
    share = picture.shape[0] // height
    cut = picture[: height * share, : width * share]
    # whole rows first: they lie together
    rows = cut.reshape(height, share, -1).mean(axis=1, dtype=np.float32)
    return rows.reshape(height, width, share, 4).mean(axis=2)
