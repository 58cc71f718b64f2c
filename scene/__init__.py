"""The words that all blocks speak: cameras, skeletons, motion, sequences, scenes. No I/O."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_MODULES = (
    "errors",
    "pose_trust",
    "expression",
    "skeleton",
    "camera",
    "motion",
    "body",
    "lighting",
    "environment",
    "sequence",
)


def __getattr__(name: str) -> Any:
    # whoever wants the errors alone, such as `metanerf --help`, waits for no numpy
    if name in __all__:
        for module in _MODULES:
            if hasattr(found := import_module(f"scene.{module}"), name):
                return getattr(found, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
