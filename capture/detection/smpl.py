"""Adapter for estimators that give a pose instead of landmarks: SPIN, 4D-Humans, any SMPL
regressor.

The 24 joints are SMPL's, so its theta (24 axis-angles) are a `Pose`'s `joint_angles` as they are;
its root translation is the network's position of the pelvis, less the body's rest pelvis.
`landmarks_of_pose` says where the 33 landmarks of that pose lie, which is what a `PoseEstimator`
returns: the fit then treats them as any other estimator's.
"""

from __future__ import annotations

import numpy as np

from capture.body.landmark_names import LANDMARK_NAMES
from capture.body.landmarks import landmarks_on
from capture.detection.landmarks import Landmarks
from scene.arrays import Array, Float
from scene.body import Body
from scene.camera import Camera
from scene.checks import require_shape
from scene.motion import Pose


def landmarks_of_pose(
    pose: Pose,
    body: Body,
    camera: Camera,
    mask: Float[Array, "H W"],
    visibility: Float[Array, "33"] | None = None,
) -> Landmarks:
    """The 33 landmarks of `body` in `pose` seen by `camera`, with `mask` (soft alpha, [0, 1]).

    Args:
        body: its joints are enough; a regressor's shape may be given by `BodyModel.body`.
        visibility: 0 to 1, one where the regressor does not say.

    Raises InvalidInput for a mask of another size than the camera's.
    """
    require_shape("mask", mask, (camera.height, camera.width))
    points, joints = landmarks_on(body)
    transforms = body.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)[joints]
    positions = np.einsum("nij,nj->ni", transforms[:, :3, :3], points) + transforms[:, :3, 3]
    pixels, _ = camera.project(positions)
    hips = [LANDMARK_NAMES.index("left_hip"), LANDMARK_NAMES.index("right_hip")]
    world = (positions - positions[hips].mean(axis=0)) @ camera.rotation.T
    seen = np.ones(len(LANDMARK_NAMES)) if visibility is None else visibility
    return Landmarks(pixels, world, seen, np.asarray(mask, dtype=np.float32))
