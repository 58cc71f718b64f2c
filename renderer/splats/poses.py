"""Estimated poses get better while the splats are trained: the gradient goes on to the joints.

A small turn w of joint k about its own place c moves every transform M_j below it by
[w]x (M_j - c), so the gradient by w is read off D M'^T, with D the gradient by M_j and M' = M_j
moved by -c.
Steps are Adam's; each correction is pulled back towards the estimate (the prior), and corrections
of neighbouring frames are drawn together, since noise is independent a frame and motion is not.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.settings import SplatSettings
from scene.arrays import Array, Float
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.sequence import Sequence
from scene.skeleton import Skeleton

_BETA1, _BETA2, _EPSILON = 0.7, 0.9, 1e-12
_FIRST_FRACTION = 0.08
"""Poses stand still until the splats have taken the person's rough colours."""
_SMOOTHING = 0.25
"""Share by which a correction moves to the mean of its neighbours, at each of its steps."""


class PoseRefinement:
    """Poses of all training frames: fixed where they are exact, else refined."""

    def __init__(self, sequence: Sequence, settings: SplatSettings) -> None:
        self.active = not sequence.exact_poses
        self._settings, self._skeleton = settings, sequence.body.skeleton
        self._estimate = sequence.motion
        frames, joints = sequence.motion.joint_angles.shape[:2]
        self._correction = np.zeros((frames, joints + 1, 3))
        """Turns in each joint's parent frame, rad; last row: shift of the root, m."""
        self._first = np.zeros_like(self._correction)
        self._second = np.zeros_like(self._correction)
        self._steps = np.zeros(frames, np.int64)
        self._fixed = self._all_transforms() if not self.active else None
        self._below = _descendants(self._skeleton)

    def transforms(self, frame: int) -> Float[Array, "K 4 4"]:
        """float32 skinning transforms of training frame `frame`."""
        if self._fixed is not None:
            return self._fixed[frame]
        angles, root = self._pose(frame)
        return self._skeleton.skinning_transforms(angles, root).astype(np.float32)

    def step(
        self, frame: int, by_transform: Float[Array, "K 3 4"], fraction: float, slower: float
    ) -> None:
        """Move the pose of `frame` down its gradient."""
        if not self.active or fraction < _FIRST_FRACTION:
            return
        gradient = self._gradient(frame, by_transform.astype(np.float64))
        self._steps[frame] += 1
        count = self._steps[frame]
        first, second = self._first[frame], self._second[frame]
        first += (1.0 - _BETA1) * (gradient - first)
        # one scale for a joint's three axes: a weak axis must not be blown up
        square = np.broadcast_to((gradient**2).mean(axis=1, keepdims=True), gradient.shape)
        second += (1.0 - _BETA2) * (square - second)
        scaled = (first / (1.0 - _BETA1**count)) / (
            np.sqrt(second / (1.0 - _BETA2**count)) + _EPSILON
        )
        rate = self._settings.pose_rate_rad * slower * (1.0 - 0.95 * fraction)
        moved = self._correction[frame] - rate * scaled
        moved *= 1.0 - self._settings.pose_pull
        neighbours = self._correction[[max(frame - 1, 0), min(frame + 1, len(self._steps) - 1)]]
        self._correction[frame] = moved + _SMOOTHING * rate / self._settings.pose_rate_rad * (
            neighbours.mean(axis=0) - moved
        )

    def motion(self) -> Motion:
        """All poses as they are now."""
        if not self.active:
            return self._estimate
        poses = [self._pose(frame) for frame in range(len(self._estimate))]
        return Motion(
            self._estimate.times_s,
            np.stack([angles for angles, _ in poses]),
            np.stack([root for _, root in poses]),
            self._estimate.confidence,
        )

    def state(self) -> dict[str, Array]:
        """Copies of what `restore` needs."""
        return {
            "pose_correction": self._correction.copy(),
            "pose_first": self._first.copy(),
            "pose_second": self._second.copy(),
            "pose_steps": self._steps.copy(),
        }

    def restore(self, state: dict[str, Array]) -> None:
        """Go back to `state`."""
        self._correction = state["pose_correction"].copy()
        self._first, self._second = state["pose_first"].copy(), state["pose_second"].copy()
        self._steps = state["pose_steps"].copy()

    def _pose(self, frame: int) -> tuple[Float[Array, "K 3"], Float[Array, "3"]]:
        turns = axis_angle_to_matrix(self._correction[frame, :-1])
        local = turns @ axis_angle_to_matrix(self._estimate.joint_angles[frame])
        root = self._estimate.root_translation[frame] + self._correction[frame, -1]
        return matrix_to_axis_angle(local), root

    def _all_transforms(self) -> Float[Array, "F K 4 4"]:
        motion = self._estimate
        return self._skeleton.skinning_transforms(
            motion.joint_angles, motion.root_translation
        ).astype(np.float32)

    def _gradient(self, frame: int, by_transform: Float[Array, "K 3 4"]) -> Float[Array, "K+1 3"]:
        angles, root = self._pose(frame)
        joints = self._skeleton.joint_transforms(angles, root)
        skinning = self._skeleton.skinning_transforms(angles, root)
        place = joints[:, :3, 3]
        # sum over j below k of D_j M_j^T, with M_j's translation taken from the joint's place
        outer = by_transform @ np.swapaxes(skinning[:, :3], -1, -2)  # [K 3 3]
        pull = by_transform[:, :, 3]  # [K 3]
        about = np.einsum("kj,jab->kab", self._below, outer) - np.einsum(
            "ka,kb->kab", self._below @ pull, place
        )
        turn = np.stack(
            [
                about[:, 2, 1] - about[:, 1, 2],
                about[:, 0, 2] - about[:, 2, 0],
                about[:, 1, 0] - about[:, 0, 1],
            ],
            axis=1,
        )
        parents = [max(p, 0) for p in self._skeleton.parents]
        frames = joints[parents, :3, :3].copy()
        frames[0] = np.eye(3)
        in_parent = np.einsum("kba,kb->ka", frames, turn)
        return np.concatenate([in_parent, pull.sum(axis=0, keepdims=True)])


def _descendants(skeleton: Skeleton) -> Float[Array, "K K"]:
    """Row k is 1 for k itself and every joint below it."""
    below = np.eye(len(skeleton.parents))
    for child in range(len(skeleton.parents) - 1, 0, -1):
        below[skeleton.parents[child]] += below[child]
    return below
