"""Refines estimated poses while the splats are trained, in passes over the whole clip.

A pass collects the photometric normal equations of all frames, from coarse pictures to fine ones,
and updates all poses and the bone lengths at once (`bundle_adjustment`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.performer_model import PerformerModel
from renderer.pose_refinement.bundle_adjustment import (
    GIVEN_DEVIATIONS,
    INITIAL_DEVIATIONS,
    ClipNormalEquations,
    ClipState,
    in_given_gauge,
    solve,
)
from renderer.pose_refinement.foot_contacts import FootContacts
from renderer.pose_refinement.photometry import (
    SHARED_PARAMETERS,
    log_bone_ratios,
    with_bone_lengths,
)
from scene.arrays import Array, Float
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import PoseTrust, Sequence
from scene.temporal import Accelerations


class PoseRefinement:
    """Poses of all training frames: fixed where they are exact, else refined.

    Continues from the poses of `start`, an earlier model of the same clip.
    """

    def __init__(self, sequence: Sequence, start: PerformerModel | None = None) -> None:
        self.active = sequence.pose_trust is not PoseTrust.EXACT
        self._given = sequence.pose_trust is PoseTrust.GIVEN
        self._first_skeleton = self.skeleton = sequence.body.skeleton
        self._estimate = current = sequence.motion
        self._operator = Accelerations.of(self._estimate.times_s)
        self._foot_contacts = FootContacts.of(self.skeleton, self._estimate)
        self._shared = np.zeros(SHARED_PARAMETERS)
        same_clip = start is not None and start.data_hash == sequence.data_hash
        # models from before frames without anybody were left out have poses of those too
        if start is not None and same_clip and len(start.motion) == len(current):
            current = start.motion
            if not self._given:
                self.skeleton = start.skeleton
                self._shared = log_bone_ratios(self._first_skeleton, self.skeleton)
        self._angles, self._root = current.joint_angles.copy(), current.root_translation.copy()
        self._deviations = np.array(GIVEN_DEVIATIONS if self._given else INITIAL_DEVIATIONS)
        self._transforms = self._all_transforms()

    def transforms(self, frame: int) -> Float[Array, "K 4 4"]:
        """float32 skinning transforms of training frame `frame`."""
        return self._transforms[frame]

    def given_transforms(self, frame: int) -> Float[Array, "K 4 4"]:
        """The same in the pose that the sequence gives `frame`."""
        pose = self._estimate.pose(frame)
        transforms = self._first_skeleton.skinning_transforms(
            pose.joint_angles, pose.root_translation
        )
        return transforms.astype(np.float32)

    def pose(self, frame: int) -> Pose:
        """The current pose of `frame`."""
        return Pose(self._angles[frame], self._root[frame])

    def apply_step(self, equations: ClipNormalEquations) -> None:
        """Update all poses and bone lengths by one Gauss-Newton step."""
        frames = len(self._angles)
        estimate = axis_angle_to_matrix(self._estimate.joint_angles)
        current = axis_angle_to_matrix(self._angles)
        rotation_correction = matrix_to_axis_angle(np.swapaxes(estimate, -1, -2) @ current)
        shift = self._root - self._estimate.root_translation
        correction = np.concatenate([rotation_correction.reshape(frames, -1), shift], axis=1)
        angular_accelerations = self._operator.of_rotations(self._angles).reshape(frames, -1)
        accelerations = np.concatenate([angular_accelerations, self._operator(self._root)], axis=1)
        contacts = self._foot_contacts.equations(self.skeleton, self._angles, self._root)
        state = ClipState(correction, self._shared, accelerations, contacts, self._deviations)
        step = solve(equations, state, self._operator)
        if self._given:
            step = in_given_gauge(step, state)
        rotations = axis_angle_to_matrix(step.poses[:, :-3].reshape(frames, -1, 3))
        self._angles = matrix_to_axis_angle(current @ rotations)
        self._root = self._root + step.poses[:, -3:]
        self._shared = self._shared + step.shared
        self._deviations = step.deviations
        self.skeleton = with_bone_lengths(self._first_skeleton, self._shared)
        self._transforms = self._all_transforms()

    def go_back(self) -> None:
        """Return to the poses and the skeleton of the sequence."""
        self._angles = self._estimate.joint_angles.copy()
        self._root = self._estimate.root_translation.copy()
        self._shared = np.zeros(SHARED_PARAMETERS)
        self.skeleton = self._first_skeleton
        self._transforms = self._all_transforms()

    def motion(self) -> Motion:
        """All current poses."""
        if not self.active:
            return self._estimate
        return replace(self._estimate, joint_angles=self._angles, root_translation=self._root)

    def state(self) -> dict[str, Array]:
        """Copies of what `restore` needs."""
        return {
            "pose_angles": self._angles.copy(),
            "pose_root": self._root.copy(),
            "pose_shared": self._shared.copy(),
            "pose_spreads": self._deviations.copy(),
        }

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        self._angles, self._root = state["pose_angles"].copy(), state["pose_root"].copy()
        self._shared, self._deviations = state["pose_shared"].copy(), state["pose_spreads"].copy()
        self.skeleton = with_bone_lengths(self._first_skeleton, self._shared)
        self._transforms = self._all_transforms()

    def _all_transforms(self) -> Float[Array, "F K 4 4"]:
        return self.skeleton.skinning_transforms(self._angles, self._root).astype(np.float32)
