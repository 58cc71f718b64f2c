"""How a performer moves by the keypoints of their webcam.

Packets go through capture's live solver (which smooths by a One-Euro filter), onto their feet and
to a head that looks level in the mean; what comes out is where the body is, where it will be in
0.15 s at its pace, and how it rests. A pose is read between these: predicted over a short gap,
eased to rest over a longer one, eased back when the person is seen again. Times are of the camera's
clock, which is told from ours by the packets that came quickest.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from capture.body.landmark_names import LANDMARK_NAMES
from capture.body.landmarks import load_body_landmarks
from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks
from capture.detection.lifter import lift
from capture.live.filter import AT_MOST_S
from capture.live.solver import LiveSolver
from scene.arrays import Array, Float
from scene.body import Body
from scene.camera import Camera
from scene.errors import InvalidInput
from scene.motion import Pose
from scene.skeleton import Skeleton
from services.live.eye_level import LevelGaze
from services.live.keypoints_packet import KeypointsPacket
from services.live.motion.expression_filter import AT_REST, ExpressionFilter, HeldExpression
from services.live.motion.foot_locking import FootLocking, LocalPose

EASE_S = 1.0
"""From the last prediction to rest."""
_BACK_S = 0.3
"""From rest to where the person is seen again."""
_FOCAL = 0.87
"""Of usual cameras, in longer sides of the picture; as the clip-wide fit starts from."""
_LEGS_SEEN = 0.3
_SIDES = ("left", "right")
_LEGS = [LANDMARK_NAMES.index(f"{s}_{part}") for s in _SIDES for part in ("knee", "ankle")]
_CLOCK_DRIFT = 1e-3
"""s a second by which what is believed of the camera's clock gives way."""
_SMALLEST_PX = 40.0
"""A smaller person tells no pose."""
_REMEMBERED = 32
"""Packets of which it is known what they came to: a second's."""
CAPTURE_TIMES = 1 << 16
"""Capture times in whole ms that are told apart."""
_SEEN_TO_CAMERA = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class SolvedPose:
    """What one packet came to."""

    captured_ms: float
    """As the packet says: a time in seconds and back may lose the last whole ms."""
    pose: Pose
    """Before the camera, at the moment of capture; neither on the floor nor with a level gaze."""
    camera: Camera
    """Of the webcam's whole picture, in the world of the pose."""


@dataclass(frozen=True, eq=False)
class _MotionState:
    """What the newest packet came to. Poses stand at the performer's position, facing the front."""

    time_s: float
    """When it was seen, by the camera's clock."""
    clock_offset_s: float
    """Our clock less the camera's."""
    now: LocalPose
    ahead: Float[Array, "24 3"]
    """Rotations (rad) of the joints in `AT_MOST_S` from then, as predicted."""
    ahead_m: Float[Array, "3"]
    """Shift of the root in that time."""
    at_rest: Callable[[], LocalPose]
    back_s: float
    """Since when the person is seen without a longer gap."""
    back_share: float
    """How far from rest they were shown then."""
    expression: HeldExpression = AT_REST
    age_ms: int = 0
    """How old the picture was when its landmarks left their page."""

    @cached_property
    def rest(self) -> LocalPose:
        """How they stand when nobody is seen."""
        return self.at_rest()

    def share(self, time_s: float) -> float:
        """How much of what is seen is shown, and not rest: 0 to 1."""
        seen_s = min(time_s, self.time_s + AT_MOST_S)
        share = min(1.0, self.back_share + max(0.0, seen_s - self.back_s) / _BACK_S)
        gone = min(max((time_s - seen_s) / EASE_S, 0.0), 1.0)
        return share * (1.0 - gone * gone * (3.0 - 2.0 * gone))

    def pose(self, now_s: float) -> Pose:
        """The pose at `now_s` of our clock."""
        time_s = now_s - self.clock_offset_s
        from scene.kinematics_kernels import (
            axis_angles_to_matrices,
            integrate_rotations,
            relative_axis_angles,
        )

        ahead = min(max((time_s - self.time_s) / AT_MOST_S, 0.0), 1.0)
        angles = integrate_rotations(self.now.local, self.ahead, ahead)
        root, share = self.now.root + ahead * self.ahead_m, self.share(time_s)
        if share < 1.0:
            away = relative_axis_angles(self.rest.local, axis_angles_to_matrices(angles))
            angles = integrate_rotations(self.rest.local, away, share)
            root = self.rest.root + share * (root - self.rest.root)
        return Pose(angles, root, now_s, share * self.expression.at(time_s))


class LiveMotion:
    """One performer, driven live. One thread follows packets; any may read."""

    def __init__(self, skeleton: Skeleton, yaw_rad: float = 0.0) -> None:
        """For a body of `skeleton`; whoever faces their camera is turned by `yaw_rad` about +y."""
        self._skeleton, self._yaw_rad = skeleton, yaw_rad
        self._foot_locking: FootLocking | None = None
        self._gaze = LevelGaze()
        self._solver: tuple[tuple[int, int], LiveSolver] | None = None
        self._states: deque[_MotionState] = deque(maxlen=_REMEMBERED)
        self._solved: deque[SolvedPose] = deque(maxlen=_REMEMBERED)
        self._expression = ExpressionFilter()

    def pose_at(self, now_s: float) -> Pose | None:
        """The pose at `now_s`, of late or to come; None until somebody has been seen. Reading
        changes nothing."""
        states = tuple(self._states)
        for state in reversed(states):
            if now_s >= state.time_s + state.clock_offset_s:
                return state.pose(now_s)
        return states[0].pose(now_s) if states else None

    def solved(self, captured_ms: float) -> SolvedPose | None:
        """What the keypoints captured then (whole ms, modulo 65,536) came to; None where none of
        the last second's were."""
        asked = int(captured_ms) % CAPTURE_TIMES
        for one in reversed(tuple(self._solved)):
            if int(one.captured_ms) % CAPTURE_TIMES == asked:
                return one
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
    def landmarks_age_ms(self) -> int:
        """How old the newest picture was when its landmarks left their page, at least 1; 0 until
        some came."""
        state = self._state
        return 0 if state is None else max(1, state.age_ms)

    @property
    def clock_offset_s(self) -> float | None:
        """Our clock less the camera's, as estimated; None until keypoints came."""
        state = self._state
        return None if state is None else state.clock_offset_s

    def update(self, packet: KeypointsPacket, arrived_s: float) -> None:
        """Move as `packet` says, which came at `arrived_s` of our clock. Takes about 0.6 ms.

        Raises InvalidInput for a packet that tells no pose: older than the last one, or with too
        little to be seen; the motion goes on as if it had not come.
        """
        time_s = packet.capture_time_ms / 1e3
        person = _landmarks(packet)
        last = self._state
        if last is not None and not last.time_s < time_s:
            raise InvalidInput(f"capture time must be later than {last.time_s}; got {time_s}")
        solver = self._solver_for(packet.width, packet.height)
        try:
            now, ahead = solver.step(person, time_s), solver.predict(time_s + AT_MOST_S)
        except (InvalidInput, ArithmeticError, np.linalg.LinAlgError) as error:
            self._solver = None  # what it believes may be spoilt
            raise InvalidInput(f"landmarks must be of a person; got none: {error}") from error
        legs = float(np.median(solver.landmark_weights[_LEGS]))
        expression = self._expression.update(packet.expression, time_s)
        seen = replace(now, expression=expression.at(time_s))
        self._solved.append(SolvedPose(packet.capture_time_ms, seen, solver.camera))
        state = self._next_state(now, ahead, arrived_s, legs_seen=legs > _LEGS_SEEN)
        self._states.append(replace(state, expression=expression, age_ms=packet.age_ms))

    def _next_state(
        self, now: Pose, ahead: Pose, arrived_s: float, *, legs_seen: bool
    ) -> _MotionState:
        last, time_s = self._state, now.time_s
        foot_locking = self._foot_locking = self._foot_locking or FootLocking(
            self._skeleton, self._yaw_rad
        )
        clock_offset_s, back_s, back_share, step_s = arrived_s - time_s, time_s, 1.0, 1.0 / 30.0
        if last is not None:
            step_s = time_s - last.time_s
            clock_offset_s = min(clock_offset_s, last.clock_offset_s + _CLOCK_DRIFT * step_s)
            back_s, back_share = last.back_s, last.back_share
            if step_s > AT_MOST_S:
                back_s, back_share = time_s, last.share(time_s)
        from scene.kinematics_kernels import relative_axis_angles

        locked = foot_locking.update(now, legs_seen=legs_seen, step_s=step_s)
        self._gaze.learn(locked.local, step_s)
        locked, later = map(self._with_level_gaze, (locked, foot_locking.ahead(ahead)))
        rotations = relative_axis_angles(locked.local, later.local)
        return _MotionState(
            time_s,
            clock_offset_s,
            locked,
            rotations,
            later.root - locked.root,
            foot_locking.at_rest(),
            back_s,
            back_share,
        )

    def _with_level_gaze(self, pose: LocalPose) -> LocalPose:
        return replace(pose, local=self._gaze.raised(pose.local))

    def _solver_for(self, width: int, height: int) -> LiveSolver:
        """The solver for pictures of this size; a turned phone needs another."""
        if self._solver is None or self._solver[0] != (width, height):
            focal = _FOCAL * max(width, height)
            k = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
            pose = np.concatenate([_SEEN_TO_CAMERA, np.zeros((3, 1))], axis=1)
            camera = Camera(k, pose, width, height)
            self._solver = (width, height), LiveSolver(Body(self._skeleton), camera, lifter=lift)
        return self._solver[1]


def warm_up() -> None:
    """Load (or, the first time on a machine, compile) what poses need, by two of a T-pose."""
    marks, hips = load_body_landmarks().rest, [LANDMARK_NAMES.index(f"{s}_hip") for s in _SIDES]
    flat = np.array([0.5, 0.5]) + (marks[:, :2] - marks[:, :2].mean(axis=0)) * [0.25, -0.25]
    world = (marks - marks[hips].mean(axis=0)) * np.diag(_SEEN_TO_CAMERA)
    legs_seen, live = np.ones(len(marks)), LiveMotion(Skeleton(load_body_model().rest_joints))
    legs_gone = legs_seen.copy()
    legs_gone[_LEGS] = 0.0
    for number, visibility in enumerate((legs_seen, legs_gone)):
        time_s = number / 30.0
        live.update(
            KeypointsPacket(number, 1e3 * time_s, 512, 512, flat, world, visibility), time_s
        )
    live.pose_at(EASE_S)


def _landmarks(packet: KeypointsPacket) -> Landmarks:
    """The packet's landmarks in px. Raises InvalidInput for somebody too small."""
    pixels = packet.xy * [packet.width, packet.height]
    tall = float(np.ptp(pixels, axis=0).max())
    if tall < _SMALLEST_PX:
        raise InvalidInput(f"the person must be at least {_SMALLEST_PX:g} px large; got {tall:.0f}")
    no_mask: Float[Array, "H W"] = np.zeros((0, 0), np.float32)
    return Landmarks(pixels, packet.world, packet.visibility, no_mask)
