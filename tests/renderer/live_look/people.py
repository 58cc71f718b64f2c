"""Somebody who was filmed from the front alone, and what a webcam sees of them."""

from __future__ import annotations

import numpy as np

from renderer.live_look.picture import WebcamPicture
from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.camera import Camera, look_at
from scene.motion import Motion, Pose
from scene.skeleton import HEAD
from tests.capture.people import body


def person_in_checks() -> SplatModel:
    """A person in checks who was filmed from the front alone."""
    whole = body()
    assert whole.rest_vertices is not None
    assert whole.blend_weights is not None
    rest, weights = whole.rest_vertices, whole.blend_weights
    checks = np.sin(200.0 * rest).prod(axis=1) > 0.0
    parameters = np.zeros((len(rest), PARAMETERS), np.float32)
    parameters[:, :3] = rest
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log(0.009)
    parameters[:, ROTATION] = 1.0
    parameters[:, COLOUR : COLOUR + 3] = np.where(checks, 0.75, 0.2)[:, None]
    parameters[:, OPACITY] = 6.0
    joints = np.argsort(-weights, axis=1)[:, :4]
    most = np.take_along_axis(weights, joints, axis=1).astype(np.float32)
    middle = whole.skeleton.rest_joints[HEAD, 2]
    return SplatModel(
        parameters,
        joints.astype(np.uint8),
        most / most.sum(axis=1, keepdims=True),
        rest[:, 2] > middle,
        whole.skeleton,
        Motion.from_poses([Pose.rest()]),
        data_hash="",
    )


def seen_from(model: SplatModel, degrees: float, time_s: float = 0.0) -> WebcamPicture:
    """What a webcam sees of them from so many degrees to their left, by their own pictures."""
    at = model.skeleton.rest_joints[HEAD] - [0.0, 0.25, 0.0]
    angle = np.radians(degrees)
    eye = at + 1.3 * np.array([np.sin(angle), 0.0, np.cos(angle)])
    camera = Camera.from_field_of_view(look_at(eye, at), 288, 288, 0.6)
    pose = Pose.rest(time_s)
    transforms = model.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    picture = SplatRenderer((model,)).render(camera, [transforms])
    rgb, matte = ((255.0 * of + 0.5).astype(np.uint8) for of in (picture[..., :3], picture[..., 3]))
    return WebcamPicture(rgb, matte, camera, pose)
