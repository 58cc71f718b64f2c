"""Keeps a live performer on their feet: upright, on the floor, and no foot slides.

A webcam rarely shows feet well, and often no legs at all. Legs that are seen move as they are seen;
unseen ones stand straight under the pelvis. The lowest foot is on the floor. A foot on the floor is
held where it is, and the leg bends to reach it (two bones, solved exactly); when the body has gone
too far from it, it takes a step. Axis y is up; lengths are in metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scene.arrays import Array, Float
from scene.motion import Pose
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import JOINT_NAMES, PARENTS, Skeleton
from services.live.motion.solved_motion import LocalPose
from services.live.settling_mean import SettlingMean

_J = {name: index for index, name in enumerate(JOINT_NAMES)}
LEGS = np.array(
    [[_J[f"{s}_{part}"] for part in ("hip", "knee", "ankle", "foot")] for s in ("left", "right")]
)
"""Of the left leg, then the right one: joints of hip, knee, ankle and foot."""
_FEET = LEGS[:, 2:].ravel()
_PARENTS = np.array(PARENTS)
_UP = np.array([0.0, 1.0, 0.0])
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


@dataclass(frozen=True, eq=False)
class FootTarget:
    """An ankle locked to the floor, or stepping."""

    position: Float[Array, "3"]
    rotation: Float[Array, "3 3"]
    """Where it is shown."""
    locked: bool = True
    offset: Float[Array, "3"] = field(default_factory=lambda: np.zeros(3))
    """From where the leg alone would have it, m; decays while it steps."""

    def stepped(
        self, wanted: Array, wanted_rotation: Array, floor_m: float, step_s: float
    ) -> FootTarget:
        """The foot a moment later, when the leg alone would have it at `wanted`."""
        from scene.kinematics_kernels import slerp

        gap, keep = self.position - wanted, math.exp(-step_s / _STEP_S)
        apart_m = math.hypot(gap[0], gap[2])
        if self.locked and not self._must_step(wanted, wanted_rotation):
            down = np.array([0.0, (1.0 - keep) * (floor_m - self.position[1]), 0.0])
            return replace(
                self, position=self.position + down, rotation=_flatter(self.rotation, 1.0 - keep)
            )
        rotation = slerp(self.rotation, wanted_rotation, 1.0 - keep)
        if not self.locked and apart_m < _LANDED_M and wanted[1] - floor_m < _FLOOR_M:
            return FootTarget(self.position, rotation)
        offset = keep * (self.position - wanted) * [1.0, 0.0, 1.0]
        lift = np.array([0.0, _LIFT * math.hypot(offset[0], offset[2]), 0.0])
        return FootTarget(wanted + offset + lift, rotation, False, offset + lift)

    def _must_step(self, wanted: Array, wanted_rotation: Array) -> bool:
        away = wanted - self.position
        far = math.hypot(away[0], away[2]) > _STEP_M
        trace = (self.rotation * wanted_rotation).sum()  # of R^T S
        twisted = trace < 1.0 + 2.0 * math.cos(_STEP_RAD)
        return bool(far or away[1] > _RAISED_M or twisted)

    def target(self, wanted: Array, wanted_rotation: Array) -> tuple[Array, Array]:
        """Position and rotation in a pose that is not the last one, a little ahead or at rest."""
        if not self.locked:
            return wanted + self.offset, wanted_rotation
        if self._must_step(wanted, wanted_rotation):
            return wanted, wanted_rotation
        return self.position, self.rotation


class FootLocking:
    """One performer's feet; belongs to one thread.

    Poses come in with axes y up and z towards the camera, which may be tilted; they come out
    upright, at x = z = 0 or about, and rotated by `yaw_rad` about +y.
    """

    def __init__(self, skeleton: Skeleton, yaw_rad: float = 0.0) -> None:
        self._rest = np.array(skeleton.rest_joints)
        self._up = SettlingMean(_UP)
        self._home: Array | None = None
        self._legs = 0.0
        """How far legs count as seen, 0 to 1."""
        self._feet: list[FootTarget] = []
        self._yaw = axis_angle_to_matrix(np.array([0.0, yaw_rad, 0.0]))
        self._upright_rotation = self._yaw
        """Of what comes in, so that it stands upright and faces the front."""

    def update(self, pose: Pose, *, legs_seen: bool, step_s: float) -> LocalPose:
        """The newest `pose` on its feet, `step_s` after the one before."""
        goal = 1.0 if legs_seen else 0.0
        if self._home is None:
            self._legs = goal
        largest_change = step_s / _LEGS_S
        self._legs += min(max(goal - self._legs, -largest_change), largest_change)
        local, pelvis = self._seen(pose)
        self._learn_up(local, pelvis, legs_seen, step_s)
        local, pelvis = self._upright(local, pelvis)
        if self._home is None:
            self._home = pelvis
        self._home = self._home + min(1.0, step_s / _HOME_S) * (pelvis - self._home)
        local, pelvis = self._grounded(local, pelvis)
        rotations, positions = placed_joints(self._rest, local, pelvis)
        wanted = [(positions[leg[2]], rotations[leg[2]]) for leg in LEGS]
        if not self._feet:
            self._feet = [FootTarget(*one) for one in wanted]
        self._feet = [
            foot.stepped(*one, float(self._rest[leg[2], 1]), step_s)
            for foot, one, leg in zip(self._feet, wanted, LEGS, strict=True)
        ]
        targets = [(foot.position, foot.rotation) for foot in self._feet]
        return with_feet(self._rest, local, pelvis, targets)

    def ahead(self, pose: Pose) -> LocalPose:
        """A pose predicted from the newest one, on the same feet."""
        local, pelvis = self._grounded(*self._upright(*self._seen(pose)))
        rotations, positions = placed_joints(self._rest, local, pelvis)
        targets = [
            foot.target(positions[leg[2]], rotations[leg[2]])
            for foot, leg in zip(self._feet, LEGS, strict=True)
        ]
        return with_feet(self._rest, local, pelvis, targets)

    @property
    def feet_locked(self) -> tuple[bool, bool]:
        """Whether the left and the right foot stand still; else they step."""
        left, right = self._feet
        return left.locked, right.locked

    def _seen(self, pose: Pose) -> tuple[Array, Array]:
        """Local rotations and the pelvis' position."""
        from scene.kinematics_kernels import axis_angles_to_matrices

        return axis_angles_to_matrices(pose.joint_angles), self._rest[0] + pose.root_translation

    def _learn_up(self, local: Array, pelvis: Array, legs_seen: bool, step_s: float) -> None:
        from scene.kinematics_kernels import rotation_between

        _, positions = placed_joints(self._rest, local, pelvis)
        # in the mean whoever stands is upright from ankles to neck; whoever shows no legs may
        # sit, with an upright trunk
        below = 0.5 * positions[LEGS[:, 2]].sum(axis=0) if legs_seen else positions[0]
        up = positions[_J["neck"]] - below
        self._up.add(up / math.sqrt(float(up @ up)), step_s)
        self._upright_rotation = self._yaw @ rotation_between(self._up.value, _UP)

    def _upright(self, local: Array, pelvis: Array) -> tuple[Array, Array]:
        """The same with the vertical where it is."""
        local = local.copy()
        local[0] = self._upright_rotation @ local[0]
        return local, self._upright_rotation @ pelvis

    def _grounded(self, local: Array, pelvis: Array) -> tuple[Array, Array]:
        """Legs as far as they are seen, straight ones for the rest; a foot on the floor."""
        assert self._home is not None
        local = local.copy()
        if self._legs < 1.0:
            self._straighten(local)
        away = (pelvis - self._home) * [1.0, 0.0, 1.0] * self._legs
        away *= min(1.0, _FARTHEST_M / max(math.hypot(away[0], away[2]), 1e-9))
        _, positions = placed_joints(self._rest, local, away)
        away[1] = (self._rest[_FEET, 1] - positions[_FEET, 1]).max()
        return local, away

    def _straighten(self, local: Array) -> None:
        """Straighten the legs as far as they are not seen."""
        from scene.kinematics_kernels import slerp
        from services.live.motion.foot_locking_kernels import level

        upright = local[0].T @ level(local[0])
        for joint in LEGS.ravel():
            straight = upright if joint in LEGS[:, 0] else np.eye(3)
            local[joint] = slerp(straight, local[joint], self._legs) if self._legs else straight


def with_feet(
    rest: Float[Array, "24 3"],
    local: Float[Array, "24 3 3"],
    pelvis: Float[Array, "3"],
    feet: Sequence[tuple[Array, Array]],
) -> LocalPose:
    """The pose whose ankles have these positions (m) and rotations; the pelvis sinks where a leg is
    too short."""
    from services.live.motion.foot_locking_kernels import reach_with

    ankles = np.array([position for position, _ in feet])
    foot_rotations = np.array([rotation for _, rotation in feet])
    local = local.copy()
    sink = reach_with(local, pelvis, rest, _PARENTS, LEGS, ankles, foot_rotations)
    drop = np.array([0.0, sink, 0.0])
    return LocalPose(local, pelvis + drop - rest[0])


def placed_joints(
    rest: Float[Array, "24 3"], local: Float[Array, "24 3 3"], pelvis: Float[Array, "3"]
) -> tuple[Float[Array, "24 3 3"], Float[Array, "24 3"]]:
    """Rotations and positions (m) of the joints in the room."""
    from scene.kinematics_kernels import forward_kinematics

    rotations, positions = np.empty_like(local), np.empty((len(local), 3))
    forward_kinematics(local, pelvis, rest, _PARENTS, rotations, positions)
    return rotations, positions


def _flatter(rotation: Array, share: float) -> Array:
    """A foot `share` of the way to lying flat on the floor."""
    from scene.kinematics_kernels import slerp
    from services.live.motion.foot_locking_kernels import level

    return rotation if rotation[1, 1] > _FLAT else slerp(rotation, level(rotation), share)
