"""A pose aligned with a picture: what remains is the model's error, not the pose's.

A model trained on estimated poses has its canonical body shifted by what the estimates had in
common, so the true pose of a test frame is not its best. Aligned, the frame's own picture corrects
the pose, as a tracker would; figures got so must say it.
"""

from __future__ import annotations

import numpy as np

from renderer.evaluation.in_motion import hung_in, rendered_hung
from renderer.performer_model import PerformerModel
from renderer.pose_refinement.photometry import (
    POSE_PARAMETERS,
    SkinnedPoints,
    apply_pose_step,
    normal_equations,
    robust_cost,
)
from renderer.splats.layout import POSITION, VISIBILITY_DILATION_PX2
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import first_splats
from scene.arrays import Array, Float, Int
from scene.camera import Camera
from scene.motion import Motion, Pose
from scene.sequence import Frame, Sequence, body_crop

_LEVELS = (4, 2, 1)
"""Shares of the resolution, from blurred to sharp: the first finds limbs many pixels away."""
_STEPS = 8
"""Steps a level."""
_SMALLEST_PX = 10
"""Side below which a level shows too little."""
_MARGIN = 0.3
"""Share of the body's box kept round it: room for a body that stands elsewhere."""
_PRIOR = 10.0
"""Weight of a squared turn (rad) or shift (m) away from what was given against squared differences
of colour: small beside what a joint shows, large beside what it hides in depth. The same at every
level, so that the blurred ones move what they see well and leave the rest."""


class Aligner:
    """Aligns poses of one model; keep it as long as the model stays."""

    def __init__(self, model: PerformerModel, sequence: Sequence) -> None:
        self._model = model
        self._hung: Float[Array, "V 3"] | None = None
        surface = model.splats
        if surface is None:
            surface = first_splats(sequence, SplatSettings(), np.random.default_rng(0))
        self._parameters = surface.parameters.astype(np.float32)
        self._points = SkinnedPoints(
            self._parameters[:, POSITION : POSITION + 3],
            surface.joints.astype(np.uint16),
            surface.weights.astype(np.float32),
        )
        self._work = Workspace(len(self._parameters))

    def align(self, frame: Frame, motion: Motion | None = None) -> Pose:
        """The pose near `frame.pose` whose picture is nearest to the frame's, by Gauss-Newton
        steps from a quarter of the resolution to the whole; never one that looks worse. Loose
        clothes hang as they swing in `motion`, of which the frame is a moment."""
        crop = body_crop(frame.mask, _MARGIN)
        if crop is None:
            return frame.pose
        self._hung = hung_in(self._model, frame.pose, motion)
        truth = np.concatenate([frame.image, frame.mask[..., None]], axis=2)[crop]
        camera = frame.camera.cropped(crop[1].start, crop[0].start, truth.shape[1], truth.shape[0])
        pose = frame.pose
        for share in _LEVELS:
            if min(truth.shape[:2]) >= share * _SMALLEST_PX:
                pose = self._descend(*_reduced(truth, camera, share), pose, frame.pose)
        better = self._cost(truth, camera, pose) < self._cost(truth, camera, frame.pose)
        return pose if better else frame.pose

    def _descend(
        self, truth: Float[Array, "H W 4"], camera: Camera, pose: Pose, given: Pose
    ) -> Pose:
        total_step = np.zeros(POSE_PARAMETERS)  # the way from `given` so far, added up
        for _ in range(_STEPS):
            equations = normal_equations(
                self._drawn(camera, pose),
                truth,
                self._front(camera, pose),
                self._points,
                self._model.skeleton,
                camera,
                pose,
            )
            step = np.linalg.solve(
                equations.matrix + _PRIOR * np.eye(POSE_PARAMETERS),
                equations.vector - _PRIOR * total_step,
            )
            pose, total_step = apply_pose_step(pose, step), total_step + step
        return pose

    def _cost(self, truth: Float[Array, "H W 4"], camera: Camera, pose: Pose) -> float:
        return robust_cost(self._drawn(camera, pose) - truth)

    def _drawn(self, camera: Camera, pose: Pose) -> Float[Array, "H W 4"]:
        return rendered_hung(self._model, camera, pose, self._hung)

    def _front(self, camera: Camera, pose: Pose) -> Int[Array, "H W"]:
        transforms = self._model.skeleton.skinning_transforms(
            pose.joint_angles, pose.root_translation
        )
        return self._work.front(
            self._parameters,
            self._points.joints,
            self._points.weights,
            transforms.astype(np.float32),
            camera,
            VISIBILITY_DILATION_PX2,
        )


def _reduced(
    truth: Float[Array, "H W 4"], camera: Camera, share: int
) -> tuple[Float[Array, "h w 4"], Camera]:
    """Box-filtered to 1/`share` of the size; what is left over at the right and below is cut."""
    height, width = truth.shape[0] // share, truth.shape[1] // share
    cropped = truth[: height * share, : width * share]
    small = cropped.reshape(height, share, width, share, 4).mean(axis=(1, 3), dtype=np.float32)
    return small, camera.cropped(0, 0, width * share, height * share).resized(width, height)
