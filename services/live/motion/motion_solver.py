"""How somebody moves by the landmarks of their webcam, where no page has solved it.

Packets go through capture's live solver (which smooths by a One-Euro filter), onto their feet and
to a head that looks level in the mean. Pages do the same before they send
(`client/src/motion/motionSolver.ts`); tests hold both to the same motion
(`tests/services/live/motion.json`, which `tools.build_motion_cases` writes).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from capture.body.landmark_names import LANDMARK_NAMES
from capture.detection.landmarks import Landmarks
from capture.detection.lifter import lift
from capture.live.filter import AT_MOST_S
from capture.live.solver import LiveSolver
from scene.arrays import Array, Float
from scene.body import Body
from scene.errors import InvalidInput
from scene.motion import Pose
from scene.skeleton import Skeleton
from services.live.eye_level import LevelGaze
from services.live.keypoints_packet import KeypointsPacket
from services.live.motion.expression_filter import ExpressionFilter
from services.live.motion.foot_locking import FootLocking
from services.live.motion.head_following import HeadFollowing, ObservedHead
from services.live.motion.solved_motion import LocalPose, SolvedMotion, SolvedPose, usual_camera

_FIRST_STEP_S = 1.0 / 30.0
_LEGS_SEEN = 0.3
LEGS = [
    LANDMARK_NAMES.index(f"{side}_{part}")
    for side in ("left", "right")
    for part in ("knee", "ankle")
]
"""The landmarks that tell whether legs are seen."""
_SMALLEST_PX = 40.0
"""A smaller person tells no pose."""


class MotionSolver:
    """One performer's; belongs to one thread."""

    def __init__(self, skeleton: Skeleton, yaw_rad: float = 0.0) -> None:
        """For a body of `skeleton`; whoever faces their camera is turned by `yaw_rad` about +y."""
        self._skeleton, self._yaw_rad = skeleton, yaw_rad
        self._foot_locking: FootLocking | None = None
        self._gaze = LevelGaze()
        self._solver: tuple[tuple[int, int], LiveSolver] | None = None
        self._expression = ExpressionFilter()
        self._head = HeadFollowing()
        self._time_s: float | None = None

    def solve(self, packet: KeypointsPacket) -> SolvedMotion:
        """What `packet` comes to. Takes about 0.6 ms.

        Raises InvalidInput for a packet that tells no pose: older than the last one, or with too
        little to be seen; the motion goes on as if it had not come.
        """
        time_s, last_s = packet.capture_time_ms / 1e3, self._time_s
        person = _landmarks(packet)
        if last_s is not None and not last_s < time_s:
            raise InvalidInput(f"capture time must be later than {last_s}; got {time_s}")
        solver = self._solver_for(packet.width, packet.height)
        try:
            now, ahead = solver.step(person, time_s), solver.predict(time_s + AT_MOST_S)
        except (InvalidInput, ArithmeticError, np.linalg.LinAlgError) as error:
            self._solver = None  # what it believes may be spoilt
            raise InvalidInput(f"landmarks must be of a person; got none: {error}") from error
        self._time_s = time_s
        now, ahead = self._with_head_followed(now, ahead, packet.head, time_s)
        expression = self._expression.update(packet.expression, time_s)
        seen = replace(now, expression=expression.at(time_s))
        legs = float(np.median(solver.landmark_weights[LEGS]))
        foot_locking = self._foot_locking = self._foot_locking or FootLocking(
            self._skeleton, self._yaw_rad
        )
        step_s = _FIRST_STEP_S if last_s is None else time_s - last_s
        locked = foot_locking.update(now, legs_seen=legs > _LEGS_SEEN, step_s=step_s)
        self._gaze.learn(locked.local, step_s)
        locked, later = map(self._with_level_gaze, (locked, foot_locking.ahead(ahead)))
        return SolvedMotion(
            packet.capture_time_ms,
            locked,
            _relative(locked, later),
            later.root - locked.root,
            foot_locking.feet_locked,
            expression,
            packet.age_ms,
            SolvedPose(packet.capture_time_ms, seen, solver.camera),
        )

    def _with_head_followed(
        self, now: Pose, ahead: Pose, head: Float[Array, "3 3"] | None, time_s: float
    ) -> tuple[Pose, Pose]:
        seen = None if head is None else ObservedHead(head, time_s)
        self._head.update(seen, now.joint_angles, time_s)
        angles = [self._head.followed(pose.joint_angles, time_s) for pose in (now, ahead)]
        return replace(now, joint_angles=angles[0]), replace(ahead, joint_angles=angles[1])

    def _with_level_gaze(self, pose: LocalPose) -> LocalPose:
        return replace(pose, local=self._gaze.raised(pose.local))

    def _solver_for(self, width: int, height: int) -> LiveSolver:
        """The solver for pictures of this size; a turned phone needs another."""
        if self._solver is None or self._solver[0] != (width, height):
            camera = usual_camera(width, height)
            self._solver = (width, height), LiveSolver(Body(self._skeleton), camera, lifter=lift)
        return self._solver[1]


def _relative(start: LocalPose, end: LocalPose) -> Float[Array, "24 3"]:
    from scene.kinematics_kernels import relative_axis_angles

    return relative_axis_angles(start.local, end.local)


def _landmarks(packet: KeypointsPacket) -> Landmarks:
    """The packet's landmarks in px. Raises InvalidInput for somebody too small."""
    pixels = packet.xy * [packet.width, packet.height]
    tall = float(np.ptp(pixels, axis=0).max())
    if tall < _SMALLEST_PX:
        raise InvalidInput(f"the person must be at least {_SMALLEST_PX:g} px large; got {tall:.0f}")
    no_mask: Float[Array, "H W"] = np.zeros((0, 0), np.float32)
    return Landmarks(pixels, packet.world, packet.visibility, no_mask)
