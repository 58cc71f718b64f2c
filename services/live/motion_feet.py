"""Keeps a live performer on their feet: upright, on the floor, and no foot slides.

A webcam rarely shows feet well, and often no legs at all. Legs that are seen move as they are seen;
unseen ones stand straight under the pelvis. The lowest foot is on the floor. A foot on the floor is
held where it is, and the leg bends to reach it (two bones, solved exactly); when the body has gone
too far from it, it takes a step. Letters: W world turn of a joint, p its place; y is up, metres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from scene.arrays import Array, Float
from scene.limits import ELBOW_HINGE
from scene.motion import Pose
from scene.rotations import axis_angle_to_matrix, rotation_between, slerp
from scene.skeleton import JOINT_NAMES, PARENTS, Skeleton

_J = {name: index for index, name in enumerate(JOINT_NAMES)}
_LEGS = np.array(
    [[_J[f"{s}_{part}"] for part in ("hip", "knee", "ankle", "foot")] for s in ("left", "right")]
)
_HIP, _KNEE, _ANKLE = _LEGS[:, :3].T
_PARENTS = np.array(PARENTS)
_FIRST_S, _UPRIGHT_S = 1.0, 20.0
"""Which way is up is learnt at once, then slowly: people lean, cameras stand."""
_HOME_S = 10.0
"""Whoever stays somewhere else ends up in the middle of their place."""
_FARTHEST_M = 0.75
_LEGS_S = 0.5
"""Time in which legs that come into sight take over."""
_STEP_M, _STEP_RAD, _RAISED_M = 0.08, 0.5, 0.05
"""How far the body may go from a foot before it steps."""
_LANDED_M, _FLOOR_M = 0.04, 0.03
_STEP_S = 0.1
"""Time in which a step goes two thirds of its way."""
_LIFT = 0.35
"""Height of a step, as a share of the way left."""
_FLAT = 1.0 - 1e-7
"""Cosine of a foot's tilt that nobody sees."""
_REACH = 0.999
"""A leg is never stretched further: a straight knee has no way to bend."""
_HANGING_RAD, _ELBOW_RAD = 1.2, 0.3


@dataclass(frozen=True, eq=False)
class _Foot:
    """An ankle on the floor, or on its way."""

    place: Float[Array, "3"]
    turn: Float[Array, "3 3"]
    """Where it is shown."""
    held: bool = True
    behind: Float[Array, "3"] = field(default_factory=lambda: np.zeros(3))
    """From where the leg alone would have it, m; while it steps."""

    def moved_on(self, wanted: Array, turned: Array, floor_m: float, step_s: float) -> _Foot:
        """The foot a moment later, when the leg alone would have it at `wanted`."""
        gap, keep = self.place - wanted, float(np.exp(-step_s / _STEP_S))
        apart_m = float(np.hypot(gap[0], gap[2]))
        if self.held and not self._must_step(wanted, turned):
            down = np.array([0.0, (1.0 - keep) * (floor_m - self.place[1]), 0.0])
            return replace(self, place=self.place + down, turn=_flatter(self.turn, 1.0 - keep))
        turn = slerp(self.turn, turned, 1.0 - keep)
        if not self.held and apart_m < _LANDED_M and wanted[1] - floor_m < _FLOOR_M:
            return _Foot(self.place, turn)
        behind = keep * (self.place - wanted) * [1.0, 0.0, 1.0]
        lift = np.array([0.0, _LIFT * float(np.hypot(behind[0], behind[2])), 0.0])
        return _Foot(wanted + behind + lift, turn, False, behind + lift)

    def _must_step(self, wanted: Array, turned: Array) -> bool:
        away = wanted - self.place
        far = np.hypot(away[0], away[2]) > _STEP_M
        twisted = (self.turn * turned).sum() < 1.0 + 2.0 * np.cos(_STEP_RAD)  # trace of R^T S
        return bool(far or away[1] > _RAISED_M or twisted)

    def shown(self, wanted: Array, turned: Array) -> tuple[Array, Array]:
        """Place and turn in a pose that is not the last one, a little ahead or at rest."""
        if not self.held:
            return wanted + self.behind, turned
        if self._must_step(wanted, turned):
            return wanted, turned
        return self.place, self.turn


@dataclass(frozen=True, eq=False)
class Stance:
    """A pose as it is computed with."""

    local: Float[Array, "24 3 3"]
    """Turns of joints relative to their parents."""
    root: Float[Array, "3"]
    """Added to the pelvis' rest position, m."""


class Standing:
    """One performer's feet; belongs to one thread.

    Poses come in with axes y up and z towards the camera, which may be tilted; they come out
    upright, at x = z = 0 or about, and turned by `yaw_rad` about +y.
    """

    def __init__(self, skeleton: Skeleton, yaw_rad: float = 0.0) -> None:
        self._rest = skeleton.rest_joints
        self._up = np.array([0.0, 1.0, 0.0])
        self._known_s = 0.0
        self._home: Array | None = None
        self._legs = 0.0
        """How far legs count as seen, 0 to 1."""
        self._feet: list[_Foot] = []
        self._away = np.zeros(3)
        self._yaw = axis_angle_to_matrix(np.array([0.0, yaw_rad, 0.0]))
        self._hanging = np.tile(np.eye(3), (len(self._rest), 1, 1))
        self._hanging[0] = self._yaw
        for side, out in (("left", 1.0), ("right", -1.0)):
            drop = np.array([0.0, 0.0, -out * _HANGING_RAD])
            self._hanging[_J[f"{side}_shoulder"]] = axis_angle_to_matrix(drop)
            bend = _ELBOW_RAD * np.array(ELBOW_HINGE[side])
            self._hanging[_J[f"{side}_elbow"]] = axis_angle_to_matrix(bend)

    def follow(self, pose: Pose, *, legs_seen: bool, step_s: float) -> Stance:
        """The newest `pose` on its feet, `step_s` after the one before."""
        goal = 1.0 if legs_seen else 0.0
        if self._home is None:
            self._legs = goal
        self._legs += float(np.clip(goal - self._legs, -step_s / _LEGS_S, step_s / _LEGS_S))
        local, pelvis = self._seen(pose)
        self._learn_up(local, pelvis, legs_seen, step_s)
        local, pelvis = self._upright(local, pelvis)
        if self._home is None:
            self._home = pelvis
        self._home = self._home + min(1.0, step_s / _HOME_S) * (pelvis - self._home)
        local, pelvis = self._standing(local, pelvis)
        self._away = pelvis * [1.0, 0.0, 1.0]
        turned, placed = self._joints(local, pelvis)
        wanted = [(placed[leg[2]], turned[leg[2]]) for leg in _LEGS]
        if not self._feet:
            self._feet = [_Foot(*one) for one in wanted]
        self._feet = [
            foot.moved_on(*one, float(self._rest[leg[2], 1]), step_s)
            for foot, one, leg in zip(self._feet, wanted, _LEGS, strict=True)
        ]
        shown = [(foot.place, foot.turn) for foot in self._feet]
        return self._reaching(local, pelvis, shown)

    def ahead(self, pose: Pose) -> Stance:
        """A pose predicted from the newest one, on the same feet."""
        standing = self._standing(*self._upright(*self._seen(pose)))
        return self._held(*standing, self._feet)

    def at_rest(self) -> Callable[[], Stance]:
        """Standing quietly where the newest pose stood, arms hanging, facing the front.

        Worked out when it is asked for, on any thread, however far the feet have gone by then.
        """
        pelvis = np.array([self._away[0], self._rest[0, 1], self._away[2]])
        return partial(self._held, self._hanging, pelvis, self._feet)

    def _held(self, local: Array, pelvis: Array, feet: list[_Foot]) -> Stance:
        turned, placed = self._joints(local, pelvis)
        shown = [
            foot.shown(placed[leg[2]], turned[leg[2]])
            for foot, leg in zip(feet, _LEGS, strict=True)
        ]
        return self._reaching(local, pelvis, shown)

    def _seen(self, pose: Pose) -> tuple[Array, Array]:
        """Local turns and the pelvis' place."""
        return axis_angle_to_matrix(pose.joint_angles), self._rest[0] + pose.root_translation

    def _learn_up(self, local: Array, pelvis: Array, legs_seen: bool, step_s: float) -> None:
        from capture.fit_world import upward

        self._known_s += step_s
        _, placed = self._joints(local, pelvis)
        share = 1.0 if self._home is None else step_s / np.clip(self._known_s, _FIRST_S, _UPRIGHT_S)
        # whoever shows no legs stands or sits: in the mean their trunk is upright
        trunk = placed[_J["neck"]] - placed[0]
        up = upward(placed[None], True) if legs_seen else trunk / np.linalg.norm(trunk)
        self._up = self._up + min(1.0, float(share)) * (up - self._up)

    def _upright(self, local: Array, pelvis: Array) -> tuple[Array, Array]:
        """The same with the vertical where it is."""
        turn = self._yaw @ rotation_between(self._up, np.array([0.0, 1.0, 0.0]))
        return np.concatenate([(turn @ local[0])[None], local[1:]]), turn @ pelvis

    def _standing(self, local: Array, pelvis: Array) -> tuple[Array, Array]:
        """Legs as far as they are seen, straight ones for the rest; a foot on the floor."""
        assert self._home is not None
        local = local.copy()
        yaw = _level(local[0])
        if self._legs < 1.0:
            straight = np.tile(np.eye(3), (*_LEGS.shape, 1, 1))
            straight[:, 0] = local[0].T @ yaw
            seen = local[_LEGS]
            local[_LEGS] = slerp(straight, seen, self._legs) if self._legs > 0.0 else straight
        away = (pelvis - self._home) * [1.0, 0.0, 1.0] * self._legs
        away *= min(1.0, _FARTHEST_M / max(float(np.linalg.norm(away)), 1e-9))
        _, placed = self._joints(local, away)
        feet = _LEGS[:, 2:]
        away[1] = float((self._rest[feet, 1] - placed[feet, 1]).max())
        return local, away

    def _reaching(self, local: Array, pelvis: Array, feet: list[tuple[Array, Array]]) -> Stance:
        """The pose whose ankles are at `feet`; the pelvis sinks where a leg is too short."""
        ankles, turns = np.array([place for place, _ in feet]), np.array([turn for _, turn in feet])
        turned, placed = self._joints(local, pelvis)
        bones = np.linalg.norm(np.diff(self._rest[_LEGS[:, :3]], axis=1), axis=2)
        across = ankles - placed[_HIP]
        reach = (_REACH * bones.sum(axis=1)) ** 2 - across[:, 0] ** 2 - across[:, 2] ** 2
        sink = min(0.0, float((np.sqrt(np.maximum(reach, 0.0)) + across[:, 1]).min()))
        drop = np.array([0.0, sink, 0.0])
        thigh, shin = bent((placed + drop)[_LEGS[:, :3]], turned[_LEGS[:, :2]], ankles)
        local = local.copy()
        local[_HIP] = turned[0].T @ thigh
        local[_KNEE] = np.swapaxes(thigh, 1, 2) @ shin
        local[_ANKLE] = np.swapaxes(shin, 1, 2) @ turns
        return Stance(local, pelvis + drop - self._rest[0])

    def _joints(self, local: Array, pelvis: Array) -> tuple[Array, Array]:
        from capture.live_kernels import place_joints

        turned, placed = np.empty_like(local), np.empty((len(local), 3))
        place_joints(local, pelvis, self._rest, _PARENTS, turned, placed)
        return turned, placed


def bent(
    leg: Float[Array, "N 3 3"], turned: Float[Array, "N 2 3 3"], ankle: Float[Array, "N 3"]
) -> tuple[Float[Array, "N 3 3"], Float[Array, "N 3 3"]]:
    """World turns of thigh and shin that bring the ankle to `ankle`, as far as the leg reaches.

    Args:
        leg: places of hip, knee and ankle now, m.
        turned: world turns of thigh and shin now; the knee stays on the side where it is.
    """
    hip, knee, foot = leg[:, 0], leg[:, 1], leg[:, 2]
    upper, lower = _length(knee - hip), _length(foot - knee)
    reach = ankle - hip
    along = reach / np.maximum(_length(reach), 1e-9)
    distance = np.clip(_length(reach), 1e-6, _REACH * (upper + lower))
    share = (upper**2 - lower**2 + distance**2) / (2.0 * distance)
    line = (foot - hip) / np.maximum(_length(foot - hip), 1e-9)
    # a nearly straight knee hardly says where it bends to: forwards
    pole = _across(knee - hip, line) + 0.1 * upper * turned[:, 0, :, 2]
    pole = _across(pole, along)
    pole /= np.maximum(_length(pole), 1e-9)
    new_knee = hip + share * along + np.sqrt(np.maximum(upper**2 - share**2, 0.0)) * pole
    before = np.stack([knee - hip, foot - knee], axis=1)
    after = np.stack([new_knee - hip, hip + distance * along - new_knee], axis=1)
    turns = rotation_between(before, after) @ turned
    return turns[:, 0], turns[:, 1]


def _level(turn: Array) -> Array:
    """The turn about the vertical alone that faces the same way."""
    x, z = turn[0, 2], turn[2, 2]
    return axis_angle_to_matrix(np.array([0.0, np.arctan2(x, z), 0.0]))


def _flatter(turn: Array, share: float) -> Array:
    """A foot `share` of the way to lying flat on the floor."""
    return turn if turn[1, 1] > _FLAT else slerp(turn, _level(turn), share)


def _length(vector: Array) -> Array:
    return np.linalg.norm(vector, axis=-1, keepdims=True)


def _across(vector: Array, unit: Array) -> Array:
    """What of `vector` is perpendicular to `unit`."""
    return vector - (vector * unit).sum(axis=-1, keepdims=True) * unit
