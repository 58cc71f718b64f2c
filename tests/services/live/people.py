"""What a webcam would say of a known person: keypoints packets of a perfect estimator."""

from __future__ import annotations

import numpy as np

from capture.body.landmark_names import LANDMARK_NAMES
from scene.camera import Camera, orbit_camera
from scene.motion import Pose
from services.live.keypoints_packet import KeypointsPacket
from tests.capture.people import body, landmark_positions

WIDTH, HEIGHT = 640, 480
LEGS = [i for i, name in enumerate(LANDMARK_NAMES) if i >= LANDMARK_NAMES.index("left_knee")]


def webcam() -> Camera:
    """Level, in front of the person, far enough to see all of them."""
    return orbit_camera((0.0, 0.9, 0.0), 3.0, 0.0, 0.0, WIDTH, HEIGHT, 0.8)


def seen(pose: Pose, sequence: int, *, legs: bool = True) -> KeypointsPacket:
    """The packet of a person in `pose`, at its time; without legs, an upper body alone."""
    camera, points = webcam(), landmark_positions(body(), pose)
    pixels, _ = camera.project(points)
    hips = [LANDMARK_NAMES.index("left_hip"), LANDMARK_NAMES.index("right_hip")]
    visibility = np.ones(33)
    visibility[LEGS] = float(legs)
    return KeypointsPacket(
        sequence,
        1e3 * pose.time_s,
        WIDTH,
        HEIGHT,
        pixels / [WIDTH, HEIGHT],
        (points - points[hips].mean(axis=0)) @ camera.rotation.T,
        visibility,
    )


def joints(pose: Pose) -> np.ndarray:
    """Places of the 24 joints, m."""
    skeleton = body().skeleton
    return skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[:, :3, 3]
