"""Brings a pose to a picture within a few milliseconds, by optical flow.

A live solver's pose is right within centimetres. Where the model in that pose and the picture
differ, dense flow from one to the other tells how far each pixel is to move, and the pose moves by
what fits the flow best: one step of least squares. What a step finds is kept for the next picture,
in which somebody is a little further on, and wrong in much the same way.
"""

from __future__ import annotations

import numpy as np

from renderer.live_look.picture import WebcamPicture
from renderer.pose_refinement.photometry import (
    POSE_PARAMETERS,
    SkinnedPoints,
    apply_pose_step,
    pixel_equations,
)
from renderer.splats.layout import POSITION, VISIBILITY_DILATION_PX2
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.workspace import Workspace, pack_camera
from scene.arrays import Array, Float, Int
from scene.camera import Camera
from scene.motion import Pose

_PIXELS = 600
"""Pixels that a step looks at."""
_FAR_PX = 6.0
"""Flow from which a pixel counts less: it hardly shows the same point."""
_STIFFNESS = 0.02
"""Of the prior that the pose stays, as a share of what the median parameter moves pixels."""
_PRIOR = 10.0
_KEPT = 0.9
"""Share of the correction that is believed of the next picture."""
_STEPS, _FIRST_STEPS = 1, 3
"""A picture; and the first, when nothing is known."""
_LARGEST_STEP = 0.35
"""rad or m: a flow that asks for more is wrong."""


class FlowAligner:
    """Aligns the poses of one model's pictures, one after the other."""

    def __init__(self, model: SplatModel) -> None:
        self._model, self._work = model, Workspace(len(model))
        self._points = SkinnedPoints(
            model.parameters[:, POSITION : POSITION + 3],
            model.joints.astype(np.int64),
            model.weights,
        )
        self._joints = model.joints.astype(np.uint16)
        self._weights = model.weights.astype(np.float32)
        import cv2

        self._flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        self._correction: Float[Array, "75"] | None = None

    def align(self, picture: WebcamPicture, shown: Float[Array, "N P"]) -> Pose:
        """The pose near `picture.pose` in which the model, drawn as `shown` (parameters of its
        splats in the colours of its clip), covers the picture best."""
        steps = _STEPS
        if self._correction is None:
            steps, self._correction = _FIRST_STEPS, np.zeros(POSE_PARAMETERS)
        self._correction *= _KEPT
        for _ in range(steps):
            pose = apply_pose_step(picture.pose, self._correction)
            self._correction += self._step(picture, pose, shown)
        return apply_pose_step(picture.pose, self._correction)

    def _step(
        self, picture: WebcamPicture, pose: Pose, shown: Float[Array, "N P"]
    ) -> Float[Array, "75"]:
        import numba

        from renderer.splats.rasteriser.tile_kernels import draw

        camera, work = picture.camera, self._work
        transforms = self._model.skeleton.skinning_transforms(
            pose.joint_angles, pose.root_translation
        )
        work.arrange(
            shown,
            self._joints,
            self._weights,
            transforms.astype(np.float32),
            pack_camera(camera),
            camera.width,
            camera.height,
            VISIBILITY_DILATION_PX2,
        )
        drawn = np.empty((camera.height, camera.width, 4), np.float32)
        draw(work.projected, work.starts, work.entries, numba.get_num_threads(), drawn)
        flow = np.zeros((camera.height, camera.width, 2), np.float32)
        flow = self._flow.calc(_luma(drawn[..., :3]), _cut_out_luma(picture), flow)
        return self._pose_step(*self._sampled(drawn[..., 3], flow), camera, pose)

    def _sampled(
        self, alpha: Float[Array, "H W"], flow: Float[Array, "H W 2"]
    ) -> tuple[Int[Array, "M"], Float[Array, "M 2"]]:
        """Splats that some of the person's pixels show, and how far those pixels are to move."""
        rows, columns = np.nonzero(alpha > 0.5)
        every = max(1, len(rows) // _PIXELS)
        rows, columns = rows[::every], columns[::every]
        front = self._work.front_of_pixels(rows, columns, alpha.shape[1])
        known = front >= 0
        return front[known], flow[rows[known], columns[known]].astype(np.float64)

    def _pose_step(
        self, front: Int[Array, "M"], moved: Float[Array, "M 2"], camera: Camera, pose: Pose
    ) -> Float[Array, "75"]:
        if not len(front):
            return np.zeros(POSE_PARAMETERS)
        weight = 1.0 / (1.0 + (moved**2).sum(axis=1) / _FAR_PX**2)
        matrix, vector = pixel_equations(
            self._points,
            front,
            weight[:, None, None] * np.eye(2),
            weight[:, None] * moved,
            self._model.skeleton,
            camera,
            pose,
        )
        stiff = _PRIOR * _STIFFNESS * max(float(np.median(np.diag(matrix))), 1e-6)
        step = np.linalg.solve(matrix + stiff * np.eye(POSE_PARAMETERS), vector)
        return np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)


def _luma(rgb: Float[Array, "H W 3"]) -> Array:
    """8 bits, of a premultiplied picture over black."""
    import cv2

    picture = (255.0 * np.clip(rgb, 0.0, 1.0)).astype(np.uint8)
    return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)


def _cut_out_luma(picture: WebcamPicture) -> Array:
    import cv2

    luma = cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2GRAY)
    return cv2.multiply(luma, picture.matte, scale=1.0 / 255.0)
