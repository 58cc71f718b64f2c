"""Draws a training's splats as a frame shows them."""

from __future__ import annotations

import numpy as np

from renderer.pose_refinement.clip_poses import PoseRefinement
from renderer.relighting.captured_light import CapturedLight
from renderer.splats.cloth.hanging import NO_CLOTH
from renderer.splats.layout import BOX_FILTER_PX2
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.training.densification import splat_errors
from renderer.splats.training.evidence import (
    Evidence,
    frames_looked_at,
    shown_pixels,
    surface_cosines,
)
from renderer.splats.training.occlusion import hidden_by_limbs
from renderer.splats.training.strays import strays_on_hands
from renderer.splats.training.trained_splats import TrainedSplats
from renderer.splats.training.views import View
from scene.arrays import Array, Float, Int
from scene.camera import Camera
from scene.rotations import axis_angle_to_matrix

_PREVIEW_PX = 384
_LIGHT_GREY = np.float32(0.93)
_BLACK = np.zeros(3, np.float32)


class FrameDrawing:
    """Draws the splats of a training as the frames of its clip show them, and compares."""

    def __init__(
        self,
        splats: TrainedSplats,
        views: list[View],
        poses: PoseRefinement,
        linear_from: float,
        *,
        estimated: bool,
    ) -> None:
        """Args:
        splats: as they are now; whoever trains them puts others in their place, and a `light`.
        linear_from: see `SplatSettings`.
        estimated: whether poses are, so that a limb may hide what seems to be seen beside it.
        """
        import numba

        self.splats = splats
        self.light: CapturedLight | None = None
        self._views, self._poses = views, poses
        self._linear_from, self._estimated = linear_from, estimated
        self._losses = np.zeros(numba.get_num_threads())

    @property
    def threads(self) -> int:
        """That draw."""
        return len(self._losses)

    def compared(
        self,
        frame: int,
        view: View,
        background: Float[Array, "3"],
        transforms: Float[Array, "K 4 4"],
    ) -> tuple[Float[Array, "N P"], Float[Array, "N P"]]:
        """Draw `view` of `frame` over `background` and compare: fills the gradients of projected
        splats; see `loss`.

        Returns the parameters as expressions and cloth have moved them, and these shaded by the
        light.
        """
        from renderer.splats.rasteriser.tile_kernels import draw_and_differentiate
        from renderer.splats.training.adam_kernels import sum_threads

        arranged, splats = self._arrange(frame, view, transforms), self.splats
        draw_and_differentiate(
            splats.work.projected,
            splats.work.starts,
            splats.work.entries,
            view.rgba,
            background,
            self._linear_from,
            splats.thread_gradients,
            self._losses,
        )
        sum_threads(splats.thread_gradients, splats.by_projected)
        return arranged

    def loss(self, view: View) -> float:
        """Mean loss of a channel in `view`, which was compared last."""
        return float(self._losses.sum()) / (3.0 * view.rgba[..., 0].size)

    def contribution(self, frame: int) -> Float[Array, "N"]:
        """Light that each splat blends into `frame`, px."""
        self.compared(frame, self._views[frame], _BLACK, self._poses.transforms(frame))
        return self.splats.contribution

    def error_in_given_pose(self, frame: int) -> float:
        """Mean loss of a channel in the pose that the sequence gives `frame`, over black."""
        view = self._views[frame]
        self.compared(frame, view, _BLACK, self._poses.given_transforms(frame))
        return self.loss(view)

    def leave_out_hidden(self, view: View) -> None:
        """Far sides, once they are closed, contribute nothing; nor do splats that a limb may hide,
        where poses are estimated."""
        splats = self.splats
        splats.contribution[splats.closed] = 0.0
        if self._estimated:
            size, focal_px = view.rgba.shape[:2], view.window.focal_px
            splats.contribution[hidden_by_limbs(splats.work, splats.limbs, size, focal_px)] = 0.0

    def pictures(self, frame: int) -> tuple[Float[Array, "H W 4"], Float[Array, "H W 4"]]:
        """The model in `frame`, and the frame; premultiplied sRGB, in the size of whole views."""
        view = self._views[frame]
        self._arrange(frame, view, self._poses.transforms(frame))
        return self._arranged(view)

    def turned(self, frame: int, angle_rad: float) -> Float[Array, "H W 4"]:
        """The model in `frame`, turned about the upright line through its pelvis: from so far
        beside. Premultiplied sRGB."""
        view, transforms = self._views[frame], self._poses.transforms(frame)
        pelvis = transforms[0] @ np.append(self._poses.skeleton.rest_joints[0], 1.0)
        turn = np.eye(4)
        turn[:3, :3] = axis_angle_to_matrix(np.array([0.0, angle_rad, 0.0]))
        turn[:3, 3] = pelvis[:3] - turn[:3, :3] @ pelvis[:3]
        self._arrange(frame, view, (turn @ transforms).astype(np.float32))
        return self._arranged(view)[0]

    def difference(self, frame: int) -> Float[Array, "H W 4"]:
        """Between the two of `pictures`."""
        made, truth = self.pictures(frame)
        return made - truth

    def splat_errors(self, frame: int) -> tuple[Float[Array, "N"], Float[Array, "N"]]:
        """See `densification.splat_errors`."""
        view, light = self._views[frame], self.contribution(frame)
        self.leave_out_hidden(view)
        return splat_errors(self.splats.work, light, *self._arranged(view))

    def evidence(self) -> Evidence:
        """How well pixels determine each splat's colour."""
        shown, cosines, splats = [], [], self.splats
        for frame in frames_looked_at(len(self._views)):
            view, light = self._views[frame], self.contribution(frame)
            self.leave_out_hidden(view)
            shown.append(shown_pixels(splats.work, light))
            eye = view.window.position
            facing = surface_cosines(splats.first, self._poses.transforms(frame), eye)
            # cloth turns as it swings, and is seen from within too
            cosines.append(np.where(splats.first.quads == NO_CLOTH, facing, 1.0))
        found = Evidence.of_frames(np.stack(shown), np.stack(cosines))
        return found.without(
            strays_on_hands(splats.parameters, found, splats.joints, splats.weights)
        )

    def front(self, frame: int) -> Int[Array, "H W"]:
        """Which splat each pixel of whole views shows in `frame`; -1 where none does."""
        splats, window = self.splats, self._views[frame].window
        moved = splats.expressions.moved(splats.parameters, frame)
        transforms = self._poses.transforms(frame)
        return splats.work.front(
            moved, splats.joints, splats.weights, transforms, window, BOX_FILTER_PX2
        )

    def _arrange(
        self, frame: int, view: View, transforms: Float[Array, "K 4 4"]
    ) -> tuple[Float[Array, "N P"], Float[Array, "N P"]]:
        """Project the splats as `view` of `frame` shows them; returns as `compared`."""
        splats, (height, width) = self.splats, view.rgba.shape[:2]
        shown = moved = splats.expressions.moved(splats.parameters, frame)
        if self.light is not None:
            eye = view.window.position
            shown = self.light.shade(moved, splats.joints, splats.weights, transforms, eye)
        splats.work.arrange(
            shown,
            splats.joints,
            splats.weights,
            transforms,
            view.camera,
            width,
            height,
            BOX_FILTER_PX2,
        )
        return moved, shown

    def _arranged(self, view: View) -> tuple[Float[Array, "H W 4"], Float[Array, "H W 4"]]:
        """A picture of what was arranged for `view`, and what that shows."""
        from renderer.splats.rasteriser.tile_kernels import draw

        drawn, work = np.empty(view.rgba.shape, np.float32), self.splats.work
        draw(work.projected, work.starts, work.entries, self.threads, drawn)
        return drawn, view.rgba.astype(np.float32) / np.float32(255.0)


def preview(
    model: SplatModel,
    camera: Camera,
    transforms: Float[Array, "K 4 4"],
    expression: Float[Array, "E"],
    hung: Float[Array, "V 3"] | None,
) -> Float[Array, "H W 3"]:
    """What a small `camera` sees of `model`, over light grey.

    Args:
        hung: how its loose clothes hang; None without any.
    """
    scale = _PREVIEW_PX / max(camera.width, camera.height)
    small = camera.resized(round(camera.width * scale), round(camera.height * scale))
    seen = SplatRenderer((model,)).render(
        small, [transforms], expressions=[expression], hung=[hung]
    )
    return seen[..., :3] + (1.0 - seen[..., 3:]) * _LIGHT_GREY
