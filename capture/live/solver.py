"""Pose from one frame's landmarks, as they come: for a person and a camera that are known.

Two damped Gauss-Newton steps (Levenberg-Marquardt) bring a pose's landmarks onto the picture: the
terms are those of the clip-wide fit (`capture.fitting.state`) without silhouette and future. They
start from the last frame's pose; at first, after a gap, where that explains the frame badly and now
and then anyway they start from what the frame says by itself too (`capture.detection.lifter`), and
the better one stays. What nothing shows stays where it was and drifts to rest. A One-Euro filter
smooths, and predicts by the latency. Nothing here sees a picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL, solve_translation
from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from capture.body.landmarks import landmarks_on
from capture.detection.landmark_arrays import height_from_trunk_px, landmark_arrays
from capture.detection.landmarks import Landmarks
from capture.detection.lifter import Lifter, closed_form
from capture.live.filter import PoseFilter, Smoothing
from scene.arrays import Array, Float
from scene.body import Body
from scene.camera import Camera
from scene.errors import InvalidInput
from scene.motion import Pose
from scene.rotations import matrix_to_axis_angle
from scene.skeleton import JOINT_COUNT, PARENTS

if TYPE_CHECKING:
    from capture.live.kernels import FrameObservation, SolverModel

STEPS = 2
STEPS_AT_FIRST = 6
"""Of a pose that the last frame's does not lead to."""
LIFTED_EVERY = 60
"""Frames between looks at a frame by itself, which cost several times as much as both steps."""
_GAP_S = 0.3
"""After so long the last pose says little."""
_TURNING_RAD_S, _MOVING_M_S = 3.0, 1.0
"""Usual pace: what landmarks tell little of, such as depth, stays about where it was."""
_BAD = 2.0
"""Times the usual energy from which a frame is explained badly."""
_PIXEL_DEVIATION = 0.016
"""Of a landmark, in heights of the person."""
_WORLD_DEVIATION_M = 0.07
_FACE_DEPTH_TRUST = 0.3
_DAMPING = 1e-2
"""Share of the diagonal that is added; ten times more after a step that made things worse."""
_FLOOR = 1e-6
_USUAL_SHARE = 0.1
"""Of each frame in the usual energy."""
_HIPS = np.array([LANDMARK_NAMES.index("left_hip"), LANDMARK_NAMES.index("right_hip")])
_SHOULDERS = [LANDMARK_NAMES.index("left_shoulder"), LANDMARK_NAMES.index("right_shoulder")]
UNKNOWNS = 3 * JOINT_COUNT + 3
"""A rotation of each joint and the pelvis' translation."""


@dataclass(eq=False)
class _State:
    """A pose that was found, its pelvis' position (m, world) and its energy."""

    local: Float[Array, "24 3 3"]
    pelvis: Float[Array, "3"]
    energy: float


class LiveSolver:
    """Follows one person with one still camera; belongs to one thread."""

    def __init__(
        self,
        body: Body,
        camera: Camera,
        *,
        latency_s: float = 0.0,
        lifter: Lifter = closed_form,
        smoothing: Smoothing | None = Smoothing(),  # noqa: B008 (frozen)
    ) -> None:
        """For `body` seen by `camera`, whose pixels are the landmarks'.

        Args:
            latency_s: how far ahead of its landmarks a pose is predicted, at most 0.15 s.
            lifter: what a frame means by itself; `capture.detection.lifter.lift` for MediaPipe's
                landmarks.
            smoothing: None gives each frame's own solution.

        Raises InvalidInput for a negative latency.
        """
        if not 0.0 <= latency_s < 10.0:
            raise InvalidInput(f"latency_s must be between 0 and 10; got {latency_s!r}")
        self.latency_s, self._lifter = latency_s, lifter
        self._camera, self._rest = camera, body.skeleton.rest_joints
        self._to_world = camera.rotation.T @ np.diag(OPENCV_TO_OPENGL)
        self._model = solver_model(body, camera)
        self._filter = None if smoothing is None else PoseFilter(smoothing)
        self._last: _State | None = None
        self._time_s = -np.inf
        self._usual, self._since = 0.0, 0
        self.trust: Float[Array, "33"] = np.zeros(len(LANDMARK_NAMES))
        """In each landmark of the newest frame, 0 to 1."""

    def step(self, landmarks: Landmarks, time_s: float) -> Pose:
        """The pose at `time_s` + latency, from the landmarks of `time_s`.

        Raises InvalidInput where time does not move on or nothing at all is seen.
        """
        if not time_s > self._time_s:
            raise InvalidInput(f"time_s must be later than {self._time_s}; got {time_s!r}")
        seen = frame_observation(landmarks, self._camera)
        state = self._solved(landmarks, seen, time_s - self._time_s)
        self._last, self._time_s, self.trust = state, time_s, seen.trust
        root = state.pelvis - self._rest[0]
        if self._filter is None:
            return Pose(matrix_to_axis_angle(state.local), root, time_s)
        self._filter.add(state.local, root, time_s)
        return self._filter.pose(time_s + self.latency_s)

    def predict(self, time_s: float) -> Pose:
        """The pose at `time_s` without landmarks: a frame is lost, or the next is late."""
        if self._filter is None:
            raise InvalidInput("predict must have a smoothing, which knows the pace; got None")
        return self._filter.pose(time_s + self.latency_s)

    def _solved(self, landmarks: Landmarks, seen: FrameObservation, step_s: float) -> _State:
        """The best pose for one frame, from the last one or from nothing."""
        found: list[_State] = []
        if self._last is not None and step_s < _GAP_S:
            start = self._last
            pull = np.full(UNKNOWNS, (_TURNING_RAD_S * step_s) ** -2)
            pull[3 * JOINT_COUNT :] = (_MOVING_M_S * step_s) ** -2
            found.append(self._refined(start.local, start.pelvis, seen, STEPS, pull))
        lost = not found
        self._since += 1
        if lost or self._since >= LIFTED_EVERY or found[0].energy > _BAD * self._usual:
            self._since = 0
            local, pelvis = self._lifted(landmarks, seen)
            steps, free = STEPS_AT_FIRST if lost else STEPS, np.zeros(UNKNOWNS)
            found.append(self._refined(local, pelvis, seen, steps, free))
        best = min(found, key=lambda one: one.energy)
        self._usual += (1.0 if lost else _USUAL_SHARE) * (best.energy - self._usual)
        return best

    def _lifted(
        self, landmarks: Landmarks, seen: FrameObservation
    ) -> tuple[Float[Array, "24 3 3"], Float[Array, "3"]]:
        """Local rotations as the lifter has them, and the pelvis' position from the landmarks."""
        from capture.live.kernels import body_landmarks

        k, world, visibility = self._camera.intrinsics, landmarks.world, landmarks.visibility
        local = self._lifter(
            seen.pixels[None], world[None], visibility[None], self._camera.focal_px, k[:2, 2]
        ).rotations[0]
        local[0] = self._to_world @ local[0]
        points = body_landmarks(local, self._model) @ self._camera.rotation.T
        shift = solve_translation(points[None], seen.pixels[None], seen.trust[None], k)[0]
        return local, (shift - self._camera.translation) @ self._camera.rotation

    def _refined(
        self,
        local: Float[Array, "24 3 3"],
        pelvis: Float[Array, "3"],
        seen: FrameObservation,
        steps: int,
        pull: Float[Array, "75"],
    ) -> _State:
        """Damped Gauss-Newton steps; `pull` (1 / deviation^2) holds each unknown at the start."""
        from capture.live.kernels import refined

        return _State(*refined(local, pelvis, self._model, seen, steps, pull, _DAMPING, _FLOOR))


def frame_observation(landmarks: Landmarks, camera: Camera) -> FrameObservation:
    """One frame's landmarks as the kernels take them. Raises InvalidInput where nothing is seen."""
    from capture.live.kernels import FrameObservation

    all_pixels, all_world, all_trust = landmark_arrays([landmarks], camera.width, camera.height)
    pixels, world, trust = all_pixels[0], all_world[0], all_trust[0]
    if not trust.any():
        raise InvalidInput("landmarks must show something inside the picture; got nothing")
    if camera.distortion is not None:
        k, distortion = camera.intrinsics, np.asarray(camera.distortion, dtype=np.float64)
        pixels = cv2.undistortPoints(pixels, k, distortion, P=k).reshape(pixels.shape)
    across, down = 0.5 * (pixels[_SHOULDERS] - pixels[_HIPS]).sum(axis=0)
    height_px = height_from_trunk_px(math.hypot(across, down))
    to_world = camera.rotation.T @ np.diag(OPENCV_TO_OPENGL)
    seen = np.ascontiguousarray((world * OPENCV_TO_OPENGL) @ to_world.T)
    return FrameObservation(
        np.ascontiguousarray(pixels), trust, seen, 1.0 / (_PIXEL_DEVIATION * height_px)
    )


def solver_model(body: Body, camera: Camera) -> SolverModel:
    """What the kernels are told of a body, its camera and the prior of poses."""
    from capture.body.pose_prior import pose_prior  # imports torch
    from capture.live.kernels import SolverModel

    landmarks, joints = landmarks_on(body)
    prior, depth_trust = pose_prior(), np.ones(len(LANDMARK_NAMES))
    depth_trust[:FACE_LANDMARKS] = _FACE_DEPTH_TRUST
    return SolverModel(
        rest=np.array(body.skeleton.rest_joints),
        parents=np.array(PARENTS),
        landmarks=landmarks,
        joints=joints,
        hips=_HIPS,
        depth_trust=depth_trust,
        camera=_packed(camera),
        per_metre=1.0 / _WORLD_DEVIATION_M,
        mean=prior.mean.numpy().astype(np.float64),
        axes=prior.axes.numpy().astype(np.float64),
        stiffness=prior.deviation.numpy().astype(np.float64) ** -2,
    )


def _packed(camera: Camera) -> Float[Array, "4 4"]:
    packed = np.zeros((4, 4))
    packed[:3] = camera.world_to_camera
    k = camera.intrinsics
    packed[3] = (k[0, 0], k[1, 1], k[0, 2], k[1, 2])
    return packed
