"""Brings a pose to a picture within a few milliseconds, by optical flow.

A live solver's pose is right within centimetres. Where the model in that pose and the picture
differ, dense flow from one to the other tells how far each pixel is to move, and the pose moves by
what fits the flow best: one step of Gauss-Newton towards the most probable pose, with the solver's
as the prior's mean. What a step finds is kept for the next picture, in which somebody is a little
further on, and wrong in much the same way.

Flow is believed along gradients of the picture alone, by its structure tensor: over plain cloth it
is smoothed in from elsewhere, and light that the clip did not have moves it.
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
from scene.arrays import Array, Float, Int, UInt8
from scene.camera import Camera
from scene.dense_flow import dense_flow
from scene.motion import Pose
from scene.structure_tensor import structure_tensor

_PIXELS = 600
"""Pixels that a step looks at."""
_FAR_PX = 6.0
"""Flow from which a pixel counts less: it hardly shows the same point."""
_PRIOR = 1500.0
"""Of the given pose: squares of pixels of flow, over all that a step looks at, that weigh as much
as 1 rad or m beside it."""
_BLUR_PX, _NOISE = 2.5, 6.0
"""Of the structure tensor: its neighbourhood, and the gradient, grey levels a pixel, that counts
half."""
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
        cut_out = _cut_out_luma(picture)
        flow = dense_flow(self._flow, _luma(drawn[..., :3]), cut_out, flow)
        rows, columns, front = self._sampled(drawn[..., 3])
        at = rows, columns
        return self._pose_step(front, flow[at].astype(float), structure(cut_out, *at), camera, pose)

    def _sampled(
        self, alpha: Float[Array, "H W"]
    ) -> tuple[Int[Array, "M"], Int[Array, "M"], Int[Array, "M"]]:
        """Rows and columns of some of the person's pixels, and the splats that they show."""
        rows, columns = np.nonzero(alpha > 0.5)
        every = max(1, len(rows) // _PIXELS)
        rows, columns = rows[::every], columns[::every]
        front = self._work.front_of_pixels(rows, columns, alpha.shape[1])
        known = front >= 0
        return rows[known], columns[known], front[known]

    def _pose_step(
        self,
        front: Int[Array, "M"],
        moved: Float[Array, "M 2"],
        tensors: Float[Array, "M 2 2"],
        camera: Camera,
        pose: Pose,
    ) -> Float[Array, "75"]:
        """What brings the correction so far nearer to the most probable one."""
        assert self._correction is not None
        if not len(front):
            return np.zeros(POSE_PARAMETERS)
        weight = 1.0 / (1.0 + (moved**2).sum(axis=1) / _FAR_PX**2)
        weighted = weight[:, None, None] * tensors
        matrix, vector = pixel_equations(
            self._points,
            front,
            weighted,
            (weighted @ moved[..., None])[..., 0],
            self._model.skeleton,
            camera,
            pose,
        )
        step = np.linalg.solve(
            matrix + _PRIOR * np.eye(POSE_PARAMETERS), vector - _PRIOR * self._correction
        )
        return np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)


def structure(
    luma: UInt8[Array, "H W"], rows: Int[Array, "M"], columns: Int[Array, "M"]
) -> Float[Array, "M 2 2"]:
    """How well a movement of pixels can be seen, by direction (x, y): 1 along a strong gradient, 0
    where `luma` is plain."""
    xx, xy, yy = (of[rows, columns].astype(float) for of in structure_tensor(luma, _BLUR_PX))
    tensors = np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2)
    return tensors / (xx + yy + _NOISE**2)[:, None, None]


def _luma(rgb: Float[Array, "H W 3"]) -> Array:
    """8 bits, of a premultiplied picture over black."""
    import cv2

    picture = (255.0 * np.clip(rgb, 0.0, 1.0)).astype(np.uint8)
    return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)


def _cut_out_luma(picture: WebcamPicture) -> Array:
    import cv2

    luma = cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2GRAY)
    return cv2.multiply(luma, picture.matte, scale=1.0 / 255.0)
