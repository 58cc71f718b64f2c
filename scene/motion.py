"""Motion: poses at times, with interpolation, smoothing and brief extrapolation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scene.arrays import Array, Float
from scene.checks import require_finite, require_shape
from scene.errors import InvalidInput
from scene.expression import EXPRESSION_COUNT, neutral
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle, slerp
from scene.skeleton import JOINT_COUNT


@dataclass(frozen=True, eq=False)
class Pose:
    """One moment of a body."""

    joint_angles: Float[Array, "K 3"]
    """Axis-angle of each joint relative to its parent, rad; row 0 is the global orientation."""
    root_translation: Float[Array, "3"]
    """Added to the pelvis' rest position, m."""
    time_s: float = 0.0
    expression: Float[Array, "E"] = field(default_factory=neutral)
    """Of `scene.expression.EXPRESSION_NAMES`, each 0 (at rest) to 1 (fully)."""

    def __post_init__(self) -> None:
        for name, shape in (
            ("joint_angles", (JOINT_COUNT, 3)),
            ("root_translation", (3,)),
            ("expression", (EXPRESSION_COUNT,)),
        ):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            require_shape(name, value, shape)
            require_finite(name, value)
            object.__setattr__(self, name, value)

    @classmethod
    def rest(cls, time_s: float = 0.0) -> Pose:
        """The T-pose at the origin."""
        return cls(np.zeros((JOINT_COUNT, 3)), np.zeros(3), time_s)


@dataclass(frozen=True, eq=False)
class Motion:
    """A run of poses in increasing time."""

    times_s: Float[Array, "F"]
    joint_angles: Float[Array, "F K 3"]
    root_translation: Float[Array, "F 3"]
    confidence: Float[Array, "F K"]
    """Confidence of each joint, 0 (guessed) to 1 (seen)."""
    expressions: Float[Array, "F E"] = field(default_factory=lambda: np.zeros((0, 0)))
    """Of each frame, see `Pose.expression`; left out, all are at rest."""

    def __post_init__(self) -> None:
        frames = len(self.times_s)
        if not self.expressions.size:
            object.__setattr__(self, "expressions", np.zeros((frames, EXPRESSION_COUNT)))
        shapes = {
            "times_s": (frames,),
            "joint_angles": (frames, JOINT_COUNT, 3),
            "root_translation": (frames, 3),
            "confidence": (frames, JOINT_COUNT),
            "expressions": (frames, EXPRESSION_COUNT),
        }
        for name, shape in shapes.items():
            value = np.asarray(getattr(self, name), dtype=np.float64)
            require_shape(name, value, shape)
            require_finite(name, value)
            object.__setattr__(self, name, value)
        if frames == 0:
            raise InvalidInput("a motion must have at least one pose; got none")
        if (np.diff(self.times_s) <= 0.0).any():
            place = int(np.argmax(np.diff(self.times_s) <= 0.0)) + 1
            raise InvalidInput(f"times_s must increase; got {self.times_s[place]} at index {place}")

    @classmethod
    def from_poses(cls, poses: Sequence[Pose]) -> Motion:
        """The motion through `poses` of full confidence."""
        return cls(
            np.array([pose.time_s for pose in poses]),
            np.array([pose.joint_angles for pose in poses]).reshape(-1, JOINT_COUNT, 3),
            np.array([pose.root_translation for pose in poses]).reshape(-1, 3),
            np.ones((len(poses), JOINT_COUNT)),
            np.array([pose.expression for pose in poses]).reshape(-1, EXPRESSION_COUNT),
        )

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def duration_s(self) -> float:
        """From the first pose to the last, s."""
        return float(self.times_s[-1] - self.times_s[0])

    def pose(self, index: int) -> Pose:
        """The pose of frame `index`."""
        return Pose(
            self.joint_angles[index],
            self.root_translation[index],
            float(self.times_s[index]),
            self.expressions[index],
        )

    def part(self, indices: Sequence[int]) -> Motion:
        """Some of the poses, in increasing order."""
        kept = list(indices)
        return Motion(
            self.times_s[kept],
            self.joint_angles[kept],
            self.root_translation[kept],
            self.confidence[kept],
            self.expressions[kept],
        )

    def followed_by(self, later: Motion) -> Motion:
        """These poses and those of `later`, whose times come after."""
        both = zip(vars(self).values(), vars(later).values(), strict=True)
        return Motion(*(np.concatenate(pair) for pair in both))

    def pose_at(self, time_s: float) -> Pose:
        """The pose at `time_s`: slerp between neighbours, the first or last pose outside."""
        after = int(np.searchsorted(self.times_s, time_s))
        if after == 0 or after == len(self):
            nearest = self.pose(min(after, len(self) - 1))
            return replace(nearest, time_s=float(time_s))
        return self._blend(after - 1, time_s)

    def extrapolated(self, time_s: float, *, at_most_s: float = 0.15) -> Pose:
        """The pose extrapolated to a `time_s` past the end at the last velocity.

        The pace is that of the last two poses; it stops after `at_most_s` seconds, since a longer
        prediction is worse than standing still.
        """
        if len(self) < 2 or time_s <= self.times_s[-1]:
            return self.pose_at(time_s)
        ahead = min(float(time_s), float(self.times_s[-1]) + at_most_s)
        pose = self._blend(len(self) - 2, ahead)
        return replace(pose, time_s=float(time_s), expression=np.clip(pose.expression, 0.0, 1.0))

    def resampled(self, frames_per_second: float) -> Motion:
        """The same motion at an even rate, from the first pose to at most the last."""
        if frames_per_second <= 0.0:
            raise InvalidInput(f"frames_per_second must be positive; got {frames_per_second!r}")
        count = int(np.floor(self.duration_s * frames_per_second + 1e-6)) + 1
        times = self.times_s[0] + np.arange(count) / frames_per_second
        poses = [self.pose_at(float(time)) for time in times]
        confidence = np.stack(
            [np.interp(times, self.times_s, column) for column in self.confidence.T], axis=1
        )
        sampled = Motion.from_poses(poses)
        return replace(sampled, times_s=times, confidence=confidence)

    def smoothed(self, sigma_s: float) -> Motion:
        """Gaussian smoothing in time, weighted by confidence.

        Rotations are averaged as matrices and projected back by SVD (the chordal mean, Hartley et
        al. 2013), so that no joint jumps where its axis-angle wraps at pi.
        """
        if sigma_s <= 0.0:
            raise InvalidInput(f"sigma_s must be positive; got {sigma_s!r}")
        gap = self.times_s[:, None] - self.times_s[None, :]
        kernel = np.exp(-0.5 * (gap / sigma_s) ** 2)
        weights = kernel[:, :, None] * np.maximum(self.confidence, 1e-3)[None, :, :]  # [F F K]
        weights /= weights.sum(axis=1, keepdims=True)
        mean = np.einsum("fgk,gkij->fkij", weights, axis_angle_to_matrix(self.joint_angles))
        u, _, vt = np.linalg.svd(mean)
        flip = np.linalg.det(u @ vt)[..., None, None]
        rotations = np.concatenate([u[..., :2], u[..., 2:] * flip], axis=-1) @ vt
        root = weights[:, :, 0] @ self.root_translation
        expressions = kernel @ self.expressions / kernel.sum(axis=1, keepdims=True)
        return Motion(
            self.times_s, matrix_to_axis_angle(rotations), root, self.confidence, expressions
        )

    def _blend(self, before: int, time_s: float) -> Pose:
        """On the geodesic through poses `before` and `before` + 1, also past its ends."""
        span = self.times_s[before + 1] - self.times_s[before]
        fraction = float((time_s - self.times_s[before]) / span)
        rotations = axis_angle_to_matrix(self.joint_angles[before : before + 2])
        angles = matrix_to_axis_angle(slerp(rotations[0], rotations[1], fraction))
        start, end = self.root_translation[before : before + 2]
        shown, next_shown = self.expressions[before : before + 2]
        return Pose(
            angles,
            start + fraction * (end - start),
            float(time_s),
            shown + fraction * (next_shown - shown),
        )
