"""The words that all blocks speak: cameras, skeletons, motion, sequences, scenes. No I/O."""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

# Threads of OpenMP and OpenBLAS spin while they wait, which starves the kernels that follow and
# every other process where cores are few: a step of training takes 1.4 times as long. The libraries
# read these once, the latter when numpy is first imported.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")

if TYPE_CHECKING:
    from scene.body import Body
    from scene.camera import Camera, look_at, orbit_camera
    from scene.environment import Environment, Performer, Scene, placement
    from scene.errors import InvalidInput, SceneError
    from scene.expression import EXPRESSION_COUNT, EXPRESSION_NAMES
    from scene.lighting import Lighting, lighting_of
    from scene.motion import Motion, Pose
    from scene.pose_trust import PoseTrust
    from scene.sequence import (
        NOVEL_VIEW,
        UNSEEN_POSE,
        Frame,
        FrameSource,
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

_HOMES = {
    "body": ("Body",),
    "camera": ("Camera", "look_at", "orbit_camera"),
    "environment": ("Environment", "Performer", "Scene", "placement"),
    "errors": ("InvalidInput", "SceneError"),
    "expression": ("EXPRESSION_COUNT", "EXPRESSION_NAMES"),
    "lighting": ("Lighting", "lighting_of"),
    "motion": ("Motion", "Pose"),
    "pose_trust": ("PoseTrust",),
    "sequence": (
        "NOVEL_VIEW",
        "UNSEEN_POSE",
        "Frame",
        "FrameSource",
        "Sequence",
        "body_crop",
        "read_frame",
    ),
    "skeleton": ("JOINT_COUNT", "JOINT_NAMES", "PARENTS", "Skeleton"),
}


def __getattr__(name: str) -> Any:
    # whoever wants the errors alone, such as `metanerf --help`, waits for no numpy
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"scene.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
