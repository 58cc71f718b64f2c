"""How a performer moves by their webcam: what was solved of each picture, read at any moment.

A pose is read between where the body is and where it will be in 0.15 s at its pace: predicted over
a short gap, eased to rest over a longer one, eased back when the person is seen again. Times are of
the camera's clock, which is told from ours by the packets that came quickest. Whether a page solved
the motion (`services.live.motion.motion_packet`) or this server does (`motion_solver`), from here
on it is one.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from capture.body.landmark_names import LANDMARK_NAMES
from capture.body.landmarks import load_body_landmarks
from capture.body.model import load_body_model
from capture.live.filter import AT_MOST_S
from scene.errors import InvalidInput
from scene.motion import Pose
from scene.skeleton import Skeleton
from services.live.keypoints_packet import KeypointsPacket
from services.live.motion.motion_packet import MotionPacket, decode_motion, encode_motion
from services.live.motion.motion_solver import LEGS, MotionSolver
from services.live.motion.resting_stance import RestingStance
from services.live.motion.solved_motion import LocalPose, SolvedMotion, SolvedPose

EASE_S = 1.0
"""From the last prediction to rest."""
_BACK_S = 0.3
"""From rest to where the person is seen again."""
_CLOCK_DRIFT = 1e-3
"""s a second by which what is believed of the camera's clock gives way."""
_REMEMBERED = 32
"""Pictures of which it is known what they came to: a second's."""
CAPTURE_TIMES = 1 << 16
"""Capture times in whole ms that are told apart."""


@dataclass(frozen=True, eq=False)
class _MotionState:
    """From one picture on, until there is a newer one."""

    motion: SolvedMotion
    clock_offset_s: float
    """Our clock less the camera's."""
    stance: RestingStance
    back_s: float
    """Since when the person is seen without a longer gap."""
    back_share: float
    """How far from rest they were shown then."""
    arrived_s: float
    """When it came, by our clock."""

    @property
    def time_s(self) -> float:
        """When they were seen, by the camera's clock."""
        return self.motion.time_s

    @cached_property
    def rest(self) -> LocalPose:
        """How they stand when nobody is seen."""
        return self.stance.at_rest(self.motion.now, self.motion.feet_locked)

    def share(self, time_s: float) -> float:
        """How much of what is seen is shown, and not rest: 0 to 1."""
        seen_s = min(time_s, self.time_s + AT_MOST_S)
        share = min(1.0, self.back_share + max(0.0, seen_s - self.back_s) / _BACK_S)
        gone = min(max((time_s - seen_s) / EASE_S, 0.0), 1.0)
        return share * (1.0 - gone * gone * (3.0 - 2.0 * gone))

    def pose(self, now_s: float) -> Pose:
        """The pose at `now_s` of our clock."""
        motion, time_s = self.motion, now_s - self.clock_offset_s
        from scene.kinematics_kernels import (
            axis_angles_to_matrices,
            integrate_rotations,
            relative_axis_angles,
        )

        ahead = min(max((time_s - self.time_s) / AT_MOST_S, 0.0), 1.0)
        angles = integrate_rotations(motion.now.local, motion.ahead, ahead)
        root, share = motion.now.root + ahead * motion.ahead_m, self.share(time_s)
        if share < 1.0:
            away = relative_axis_angles(self.rest.local, axis_angles_to_matrices(angles))
            angles = integrate_rotations(self.rest.local, away, share)
            root = self.rest.root + share * (root - self.rest.root)
        return Pose(angles, root, now_s, share * motion.expression.at(time_s))


class LiveMotion:
    """One performer, driven live. One thread follows their pictures; any may read."""

    def __init__(self, skeleton: Skeleton, yaw_rad: float = 0.0) -> None:
        """For a body of `skeleton`; whoever faces their camera is turned by `yaw_rad` about +y."""
        self._solver = MotionSolver(skeleton, yaw_rad)
        self._stance = RestingStance(skeleton, yaw_rad)
        self._states: deque[_MotionState] = deque(maxlen=_REMEMBERED)

    def pose_at(self, now_s: float) -> Pose | None:
        """The pose at `now_s`, of late or to come; None until somebody has been seen. Reading
        changes nothing."""
        states = tuple(self._states)
        for state in reversed(states):
            if now_s >= state.time_s + state.clock_offset_s:
                return state.pose(now_s)
        return states[0].pose(now_s) if states else None

    def solved(self, captured_ms: float) -> SolvedPose | None:
        """Where they were in the picture captured then (whole ms, modulo 65,536); None where that
        is none of the last second's, or none that live look travels with."""
        asked = int(captured_ms) % CAPTURE_TIMES
        for state in reversed(tuple(self._states)):
            seen = state.motion.seen
            if seen is not None and int(seen.captured_ms) % CAPTURE_TIMES == asked:
                return seen
        return None

    @property
    def _state(self) -> _MotionState | None:
        """The newest."""
        return self._states[-1] if self._states else None

    @property
    def captured_ms(self) -> float | None:
        """When the newest of what was followed was seen, by the camera's clock."""
        state = self._state
        return None if state is None else 1e3 * state.time_s

    @property
    def arrived_s(self) -> float | None:
        """When the newest of what was followed came, by our clock."""
        state = self._state
        return None if state is None else state.arrived_s

    @property
    def landmarks_age_ms(self) -> int:
        """How old the newest picture was when its landmarks left their page, at least 1; 0 until
        some came."""
        state = self._state
        return 0 if state is None else max(1, state.motion.age_ms)

    @property
    def clock_offset_s(self) -> float | None:
        """Our clock less the camera's, as estimated; None until keypoints came."""
        state = self._state
        return None if state is None else state.clock_offset_s

    def update(self, packet: KeypointsPacket, arrived_s: float) -> None:
        """Move as the landmarks of `packet` say, which came at `arrived_s` of our clock.

        Raises InvalidInput for a packet that tells no pose: older than the last one, or with too
        little to be seen; the motion goes on as if it had not come.
        """
        self.follow(self._solver.solve(packet), arrived_s)

    def follow(self, motion: SolvedMotion, arrived_s: float) -> None:
        """Move as `motion` says, which came at `arrived_s` of our clock.

        Raises InvalidInput where it is not later than the last one.
        """
        last, time_s = self._state, motion.time_s
        clock_offset_s, back_s, back_share = arrived_s - time_s, time_s, 1.0
        if last is not None:
            step_s = time_s - last.time_s
            if not step_s > 0.0:
                raise InvalidInput(f"capture time must be later than {last.time_s}; got {time_s}")
            clock_offset_s = min(clock_offset_s, last.clock_offset_s + _CLOCK_DRIFT * step_s)
            back_s, back_share = last.back_s, last.back_share
            if step_s > AT_MOST_S:
                back_s, back_share = time_s, last.share(time_s)
        self._states.append(
            _MotionState(motion, clock_offset_s, self._stance, back_s, back_share, arrived_s)
        )


def warm_up() -> None:
    """Load (or, the first time on a machine, compile) what poses need, by two of a T-pose."""
    marks, hips = (
        load_body_landmarks().rest,
        [LANDMARK_NAMES.index(f"{s}_hip") for s in ("left", "right")],
    )
    flat = np.array([0.5, 0.5]) + (marks[:, :2] - marks[:, :2].mean(axis=0)) * [0.25, -0.25]
    world = (marks - marks[hips].mean(axis=0)) * OPENCV_TO_OPENGL
    skeleton, legs_seen = Skeleton(load_body_model().rest_joints), np.ones(len(marks))
    solver, live, legs_gone = MotionSolver(skeleton), LiveMotion(skeleton), legs_seen.copy()
    legs_gone[LEGS] = 0.0
    for number, visibility in enumerate((legs_seen, legs_gone)):
        time_ms = 1e3 * number / 30.0
        motion = solver.solve(KeypointsPacket(number, time_ms, 512, 512, flat, world, visibility))
        sent = encode_motion(MotionPacket(number, motion, live_look=True))
        live.follow(decode_motion(sent).motion, time_ms / 1e3)
    live.pose_at(EASE_S)
