"""The words that all blocks speak: cameras, skeletons, motion, sequences, scenes. No I/O."""

from scene.body import Body
from scene.camera import Camera, look_at, orbit_camera
from scene.environment import Environment, Performer, Scene, placement
from scene.errors import InvalidInput, SceneError
from scene.expression import EXPRESSION_COUNT, EXPRESSION_NAMES
from scene.lighting import Lighting, lighting_of
from scene.motion import Motion, Pose
from scene.sequence import (
    NOVEL_VIEW,
    UNSEEN_POSE,
    Frame,
    FrameSource,
    PoseTrust,
    Sequence,
    body_crop,
    read_frame,
)
from scene.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Skeleton

__all__ = [
    "EXPRESSION_COUNT",
    "EXPRESSION_NAMES",
    "JOINT_COUNT",
    "JOINT_NAMES",
    "NOVEL_VIEW",
    "PARENTS",
    "UNSEEN_POSE",
    "Body",
    "Camera",
    "Environment",
    "Frame",
    "FrameSource",
    "InvalidInput",
    "Lighting",
    "Motion",
    "Performer",
    "Pose",
    "PoseTrust",
    "Scene",
    "SceneError",
    "Sequence",
    "Skeleton",
    "body_crop",
    "lighting_of",
    "look_at",
    "orbit_camera",
    "placement",
    "read_frame",
]
