"""The skeleton: 24 joints with the names and the tree of SMPL, and forward kinematics.

Rest is the T-pose: arms along +-x, legs straight down, y up, the person facing +z (their left is
+x), lowest vertex at y = 0, pelvis at x = z = 0. At rest every joint's frame is parallel to the
world's, so identity joint angles are the T-pose. Joint 0 carries the global orientation; its world
position is rest_joints[0] + root_translation (SMPL: Loper et al. 2015, eq. 2-4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scene.arrays import Array, Float
from scene.checks import require_finite, require_shape
from scene.errors import InvalidInput
from scene.rotations import axis_angle_to_matrix

JOINT_NAMES: tuple[str, ...] = (
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
)
PARENTS: tuple[int, ...] = (
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21,
)  # fmt: skip
JOINT_COUNT = len(JOINT_NAMES)
HEAD = JOINT_NAMES.index("head")
CHEST = JOINT_NAMES.index("spine3")
FOOT_JOINTS: tuple[int, ...] = tuple(
    JOINT_NAMES.index(f"{side}_{part}") for side in ("left", "right") for part in ("ankle", "foot")
)
"""Ankle and ball of the left foot, then of the right."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of joints at rest."""

    rest_joints: Float[Array, "K 3"]
    """Joint positions in the T-pose, m."""
    names: tuple[str, ...] = JOINT_NAMES
    parents: tuple[int, ...] = PARENTS
    """Index of each joint's parent; -1 for the root, and always before the child."""

    def __post_init__(self) -> None:
        rest = np.asarray(self.rest_joints, dtype=np.float64)
        require_shape("rest_joints", rest, (len(self.names), 3))
        require_finite("rest_joints", rest)
        object.__setattr__(self, "rest_joints", rest)
        ordered = all(parent < child for child, parent in enumerate(self.parents))
        if len(self.parents) != len(self.names) or self.parents[0] != -1 or not ordered:
            raise InvalidInput(
                f"parents must name one earlier joint a joint, -1 first; got {self.parents}"
            )

    def joint_transforms(
        self, joint_angles: Float[Array, "*batch K 3"], root_translation: Float[Array, "*batch 3"]
    ) -> Float[Array, "*batch K 4 4"]:
        """Joint frame -> world, for axis-angle `joint_angles` (rad) and `root_translation` (m)."""
        rotations = axis_angle_to_matrix(np.asarray(joint_angles, dtype=np.float64))
        world = np.zeros((*rotations.shape[:-2], 4, 4))
        world[..., 3, 3] = 1.0
        for joint, parent in enumerate(self.parents):
            if parent < 0:
                world[..., joint, :3, :3] = rotations[..., joint, :, :]
                world[..., joint, :3, 3] = self.rest_joints[joint] + root_translation
                continue
            above = world[..., parent, :3, :3]
            bone = self.rest_joints[joint] - self.rest_joints[parent]
            world[..., joint, :3, :3] = above @ rotations[..., joint, :, :]
            world[..., joint, :3, 3] = world[..., parent, :3, 3] + above @ bone
        return world

    def skinning_transforms(
        self, joint_angles: Float[Array, "*batch K 3"], root_translation: Float[Array, "*batch 3"]
    ) -> Float[Array, "*batch K 4 4"]:
        """Rest -> world of what is rigidly bound to each joint: M_k of linear blend skinning."""
        skinning = self.joint_transforms(joint_angles, root_translation)
        turned = skinning[..., :3, :3] @ self.rest_joints[:, :, None]
        skinning[..., :3, 3] -= turned[..., 0]
        return skinning

    def ground_height(
        self, joint_angles: Float[Array, "F K 3"], root_translation: Float[Array, "F 3"]
    ) -> float:
        """Height (m) of what feet stand on: how far above its place at rest the lowest of
        `FOOT_JOINTS` is, in all but the lowest fifth of the frames."""
        feet = list(FOOT_JOINTS)
        heights = self.joint_transforms(joint_angles, root_translation)[:, feet, 1, 3]
        return float(np.percentile((heights - self.rest_joints[feet, 1]).min(axis=1), 20))

    @property
    def height_m(self) -> float:
        """From the floor to the head joint at rest, m."""
        return float(self.rest_joints[:, 1].max())
