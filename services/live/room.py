"""A meeting's live state: where each performer stands, and how they move now."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float
from scene.camera import Camera, orbit_camera
from scene.environment import Environment, Performer, Scene
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle

_EYE_LEVEL_SHARE = 0.55
"""Height of the first view's target, as a share of the tallest performer."""


@dataclass(frozen=True, eq=False)
class MeetingPerformer:
    """One performer of a meeting: a model, its motion, and its position in the room."""

    performer_id: str
    name: str
    model: PerformerModel
    motion: Motion
    position: tuple[float, float, float]
    yaw_rad: float
    account: str = ""
    """The account that owns the person and alone may drive them live; empty: nobody."""


class MotionSource(Protocol):
    """The motion of a performer who is driven live; see services.live.motion."""

    def pose_at(self, now_s: float) -> Pose | None:
        """The pose at `now_s`; None until one is known."""
        ...

    @property
    def captured_ms(self) -> float | None:
        """Capture time of the newest keypoints, by the camera's clock; None until some came."""
        ...


@dataclass(eq=False)
class Room:
    """What every viewer of one meeting sees. Reading it changes nothing."""

    meeting_id: str
    performers: tuple[MeetingPerformer, ...]
    environment: Environment = field(default_factory=Environment)
    live_motions: dict[str, MotionSource] = field(default_factory=dict)
    """By performer id, of those who are driven live now."""

    def scene_at(self, now_s: float, *, hide_unseen: bool = False) -> Scene[PerformerModel]:
        """The scene at `now_s`: performers driven live, or playing their motion back and forth.

        With `hide_unseen`, parts of them that were never filmed fade out.
        """
        performers = tuple(
            Performer(
                performer.name,
                performer.model.filmed_parts() if hide_unseen else performer.model,
                np.array(performer.position, dtype=np.float64),
                performer.yaw_rad,
                self._pose(performer, now_s),
            )
            for performer in self.performers
        )
        return Scene(self.environment, performers)

    def _pose(self, performer: MeetingPerformer, now_s: float) -> Pose:
        live = self.live_motions.get(performer.performer_id)
        pose = live.pose_at(now_s) if live is not None else None
        return pose or in_place(ping_pong_pose(performer.motion, now_s))

    def initial_camera(self, width: int, height: int) -> Camera:
        """Where a viewer stands before they have moved: in front of everybody, at eye level."""
        positions = np.array([one.position for one in self.performers] or [(0.0, 0.0, 0.0)])
        tallest = max((m.model.skeleton.height_m for m in self.performers), default=1.7)
        target = positions.mean(axis=0) + np.array([0.0, _EYE_LEVEL_SHARE * tallest, 0.0])
        spread = float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).max())
        return orbit_camera(target, 3.2 + 2.0 * spread, 0.0, 0.08, width, height)


def ping_pong_pose(motion: Motion, now_s: float) -> Pose:
    """The pose at `now_s` of a motion that plays forwards, then backwards, and so on for ever."""
    if motion.duration_s <= 0.0:
        return motion.pose(0)
    phase = np.mod(now_s, 2.0 * motion.duration_s)
    along = phase if phase <= motion.duration_s else 2.0 * motion.duration_s - phase
    return motion.pose_at(float(motion.times_s[0] + along))


def in_place(pose: Pose) -> Pose:
    """`pose` without the horizontal motion of its root; its height stays."""
    translation = pose.root_translation * [0.0, 1.0, 0.0]
    return replace(pose, root_translation=translation)


def facing_yaw(motion: Motion) -> float:
    """The yaw (rad about +y) that turns the mean facing direction of `motion` towards +z."""
    forward: Float[Array, "F 3"] = axis_angle_to_matrix(motion.joint_angles[:, 0])[:, :, 2]
    mean = forward.mean(axis=0)
    if np.hypot(mean[0], mean[2]) < 0.2:  # somebody turns all round: take the first frame
        mean = forward[0]
    return float(-np.arctan2(mean[0], mean[2]))


def circle_layout(
    count: int, radius_m: float = 1.0
) -> list[tuple[tuple[float, float, float], float]]:
    """Positions and yaws of `count` people round a circle, facing its centre; one alone is at 0.

    The circle opens towards +z, where viewers come in.
    """
    if count == 1:
        return [((0.0, 0.0, 0.0), 0.0)]
    angles = np.linspace(-0.75, 0.75, count) * np.pi * min(1.0, count / 6.0 + 0.2) + np.pi
    return [
        (
            (float(radius_m * np.sin(a)), 0.0, float(radius_m * np.cos(a))),
            float(matrix_to_axis_angle(axis_angle_to_matrix(np.array([0.0, a - np.pi, 0.0])))[1]),
        )
        for a in angles
    ]
