"""A meeting's live state: where each performer stands, and how they move now."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from renderer.performer_model import PerformerModel
from scene.arrays import Array, Float
from scene.camera import Camera, orbit_camera
from scene.environment import Environment, Performer, Scene
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import HEAD, Skeleton
from services.arrangement import Placed, place, view_from_the_front
from services.live.look.picture import LookSink

_FIRST_FOV_Y_RAD = 0.6
"""Of pictures before a viewer has told how they look."""
_EYES_ABOVE_HEAD_JOINT_M = 0.05
_MOST_POSES = 30
"""So many of a motion tell how high somebody's eyes are."""


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
    """The account that owns the person and may drive them live; empty: nobody."""
    lent: bool = False
    """Whether the person consents to being driven by whoever is in the meeting."""
    learns: bool = False
    """Whether the person consents to learning from pictures that are kept."""

    @classmethod
    def at_place(
        cls, performer_id: str, name: str, model: PerformerModel, number: int
    ) -> MeetingPerformer:
        """Somebody at the place of this number, who moves by their model's own motion."""
        x_m, z_m, yaw_rad = place(number)
        yaw_rad += facing_yaw(model.motion)
        return cls(performer_id, name, model, model.motion, (x_m, 0.0, z_m), yaw_rad)

    @property
    def placed(self) -> Placed:
        """Where they are, which way they face in the room, and where their eyes are."""
        x_m, _, z_m = self.position
        facing_rad = self.yaw_rad - facing_yaw(self.motion)
        return Placed(x_m, z_m, facing_rad, eye_height(self.model.skeleton, self.motion))


class MotionSource(Protocol):
    """The motion of a performer who is driven live; see services.live.motion."""

    def pose_at(self, now_s: float) -> Pose | None:
        """The pose at `now_s`; None until one is known."""
        ...

    @property
    def captured_ms(self) -> float | None:
        """Capture time of the newest keypoints, by the camera's clock; None until some came."""
        ...

    @property
    def arrived_s(self) -> float | None:
        """When these came, by the view sessions' clock; None until some came."""
        ...

    @property
    def landmarks_age_ms(self) -> int:
        """How old their picture was when they left their page, at least 1; 0 until some came."""
        ...


@dataclass(eq=False)
class Room:
    """What every viewer of one meeting sees. Reading it changes nothing."""

    meeting_id: str
    performers: tuple[MeetingPerformer, ...]
    environment: Environment = field(default_factory=Environment)
    live_motions: dict[str, MotionSource] = field(default_factory=dict)
    """By performer id, of those who are driven live now."""
    looks: dict[str, LookSink] = field(default_factory=dict)
    """By performer id, of those whose page may send pictures of them now."""
    sealed: bool = False
    """Whether motion is encrypted: it is passed on as it came, and nothing can be drawn."""
    sealed_motions: dict[str, bytes] = field(default_factory=dict)
    """By performer id, the newest sealed packet that was not passed on yet."""

    @property
    def newest_arrival_s(self) -> float:
        """When the newest motion of anybody came, by our clock; -inf before the first."""
        arrivals = [motion.arrived_s for motion in list(self.live_motions.values())]
        return max((one for one in arrivals if one is not None), default=-math.inf)

    def scene_at(
        self, now_s: float, *, hide_unseen: bool = False, live_look: bool = False
    ) -> Scene[PerformerModel]:
        """The scene at `now_s`: performers driven live, or playing their motion back and forth.

        With `hide_unseen`, parts of them that were never filmed fade out. With `live_look`, those
        who send pictures look as in the newest, and move as they did then.
        """
        performers = (
            self._performer(one, now_s, hide_unseen, live_look) for one in self.performers
        )
        return Scene(self.environment, tuple(performers))

    def _performer(
        self, performer: MeetingPerformer, now_s: float, hide_unseen: bool, live_look: bool
    ) -> Performer[PerformerModel]:
        look = self.looks.get(performer.performer_id) if live_look else None
        shown = None if look is None else look.shown_of(performer.model)
        behind_s = 0.0 if shown is None else shown.behind_s
        return Performer(
            performer.name,
            performer.model.filmed_parts() if hide_unseen else performer.model,
            np.array(performer.position, dtype=np.float64),
            performer.yaw_rad,
            self._pose(performer, now_s - behind_s),
            None if shown is None else shown.appearance,
        )

    def _pose(self, performer: MeetingPerformer, now_s: float) -> Pose:
        live = self.live_motions.get(performer.performer_id)
        pose = live.pose_at(now_s) if live is not None else None
        return pose or in_place(ping_pong_pose(performer.motion, now_s))

    def initial_camera(self, width: int, height: int) -> Camera:
        """Where a viewer stands before they have told where: in front of everybody."""
        view = view_from_the_front([one.placed for one in self.performers])
        return orbit_camera(
            view.target,
            view.distance_for(width / height, _FIRST_FOV_Y_RAD),
            view.azimuth_rad,
            view.elevation_rad,
            width,
            height,
            _FIRST_FOV_Y_RAD,
        )


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


def eye_height(skeleton: Skeleton, motion: Motion) -> float:
    """Mean height (m) above the floor of the eyes of a body of `skeleton` in `motion`."""
    frames = np.linspace(0, len(motion) - 1, min(len(motion), _MOST_POSES)).round().astype(int)
    joints = skeleton.joint_transforms(motion.joint_angles[frames], motion.root_translation[frames])
    return float(joints[:, HEAD, 1, 3].mean()) + _EYES_ABOVE_HEAD_JOINT_M
