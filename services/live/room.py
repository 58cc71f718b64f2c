"""A meeting's live state: who stands where, and how each of them moves now."""

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
class CastMember:
    """One performer of a meeting: a model, how it moves and its place in the room."""

    performer_id: str
    name: str
    model: PerformerModel
    motion: Motion
    position: tuple[float, float, float]
    yaw_rad: float
    account: str = ""
    """Whose person it is, who alone may drive them live; empty: nobody."""


class MovesLive(Protocol):
    """Somebody who is driven live; see services.live.motion."""

    def pose_at(self, now_s: float) -> Pose | None:
        """How they stand at `now_s`; None until that is known."""
        ...

    @property
    def captured_ms(self) -> float | None:
        """When what they do now was seen, by the clock of their camera; None until that is."""
        ...


@dataclass(eq=False)
class Room:
    """What every viewer of one meeting looks at. Reading it changes nothing."""

    meeting_id: str
    cast: tuple[CastMember, ...]
    environment: Environment = field(default_factory=Environment)
    live: dict[str, MovesLive] = field(default_factory=dict)
    """Performer id -> their own motion, for those who are driven live now."""

    def scene_at(self, now_s: float, *, hide_unseen: bool = False) -> Scene[PerformerModel]:
        """The scene at `now_s`: performers as they are driven live, or by their motion to and fro.

        With `hide_unseen` what was never filmed of them fades away.
        """
        performers = tuple(
            Performer(
                member.name,
                member.model.captured_only() if hide_unseen else member.model,
                np.array(member.position, dtype=np.float64),
                member.yaw_rad,
                self._pose(member, now_s),
            )
            for member in self.cast
        )
        return Scene(self.environment, performers)

    def _pose(self, member: CastMember, now_s: float) -> Pose:
        driven = self.live.get(member.performer_id)
        pose = driven.pose_at(now_s) if driven is not None else None
        return pose or grounded(to_and_fro(member.motion, now_s))

    def captured_ms(self) -> float | None:
        """When the newest of what moves anybody live was seen, by their camera's clock."""
        seen = [driven.captured_ms for driven in list(self.live.values())]
        return max((ms for ms in seen if ms is not None), default=None)

    def first_view(self, width: int, height: int) -> Camera:
        """Where a viewer stands before they have moved: in front of everybody, at eye level."""
        places = np.array([member.position for member in self.cast] or [(0.0, 0.0, 0.0)])
        tallest = max((m.model.skeleton.height_m for m in self.cast), default=1.7)
        target = places.mean(axis=0) + np.array([0.0, _EYE_LEVEL_SHARE * tallest, 0.0])
        spread = float(np.linalg.norm(places - places.mean(axis=0), axis=1).max())
        return orbit_camera(target, 3.2 + 2.0 * spread, 0.0, 0.08, width, height)


def to_and_fro(motion: Motion, now_s: float) -> Pose:
    """The pose of an endless, jump-free performance: forwards, then backwards, and so on."""
    if motion.duration_s <= 0.0:
        return motion.pose(0)
    phase = np.mod(now_s, 2.0 * motion.duration_s)
    along = phase if phase <= motion.duration_s else 2.0 * motion.duration_s - phase
    return motion.pose_at(float(motion.times_s[0] + along))


def grounded(pose: Pose) -> Pose:
    """`pose` standing at its place in the room: where it walked to is taken out, height stays."""
    translation = pose.root_translation * [0.0, 1.0, 0.0]
    return replace(pose, root_translation=translation)


def facing_yaw(motion: Motion) -> float:
    """The yaw (rad about +y) that turns the mean facing direction of `motion` towards +z."""
    forward: Float[Array, "F 3"] = axis_angle_to_matrix(motion.joint_angles[:, 0])[:, :, 2]
    mean = forward.mean(axis=0)
    if np.hypot(mean[0], mean[2]) < 0.2:  # turns all the way round: the first frame decides
        mean = forward[0]
    return float(-np.arctan2(mean[0], mean[2]))


def circle_places(
    count: int, radius_m: float = 1.0
) -> list[tuple[tuple[float, float, float], float]]:
    """Places (position, yaw) of `count` people round a circle, facing its middle; one alone: at 0.

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
