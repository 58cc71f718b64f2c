"""What one picture of somebody came to, whoever solved it: their page, or this server."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Pose
from services.live.motion.expression_filter import HeldExpression

_FOCAL = 0.87
"""Of usual cameras, in longer sides of the picture; as the clip-wide fit starts from."""


@dataclass(frozen=True, eq=False)
class LocalPose:
    """A pose by matrices, as it is computed with."""

    local: Float[Array, "24 3 3"]
    """Rotations of joints relative to their parents."""
    root: Float[Array, "3"]
    """Added to the pelvis' rest position, m."""


@dataclass(frozen=True, eq=False)
class SolvedPose:
    """Where somebody was in one picture."""

    captured_ms: float
    """As the packet says: a time in seconds and back may lose the last whole ms."""
    pose: Pose
    """Before the camera, at the moment of capture; neither on the floor nor with a level gaze."""
    camera: Camera
    """Of the webcam's whole picture, in the world of the pose."""


@dataclass(frozen=True, eq=False)
class SolvedMotion:
    """Where somebody is by one picture, and where they will be in a moment at their pace."""

    captured_ms: float
    """By the camera's clock."""
    now: LocalPose
    """On their feet with a level gaze, at the performer's position, facing the front."""
    ahead: Float[Array, "24 3"]
    """Rotations (rad) of the joints in `capture.live.filter.AT_MOST_S` from then, as predicted."""
    ahead_m: Float[Array, "3"]
    """Shift of the root in that time."""
    feet_locked: tuple[bool, bool]
    """Whether the left and the right foot stand still; else they step."""
    expression: HeldExpression
    age_ms: int
    """How old the picture was when what came of it left their page."""
    seen: SolvedPose | None
    """For live look; None where no picture of them travels with the motion."""

    @property
    def time_s(self) -> float:
        """Of the picture, by the camera's clock."""
        return self.captured_ms / 1e3


def usual_camera(width: int, height: int) -> Camera:
    """Of a webcam's picture of so many px, at the origin of what it sees."""
    focal = _FOCAL * max(width, height)
    k = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    pose = np.concatenate([np.diag(OPENCV_TO_OPENGL), np.zeros((3, 1))], axis=1)
    return Camera(k, pose, width, height)
