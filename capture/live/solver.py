"""Live poses from the landmarks of one frame at a time, for a known body and camera.

Two damped Gauss-Newton steps (Levenberg-Marquardt) bring a pose's landmarks onto the picture: the
terms are those of the clip-wide fit (`capture.fitting.state`) without silhouette and future. They
start from the last frame's pose; at first, after a gap, where that fits the frame badly, and every
`LIFT_EVERY` frames they start from the frame's own lifted pose too (`capture.detection.lifter`),
and the pose of lower energy is kept. Joints without landmarks keep their rotation and drift to the
prior's mean. A One-Euro filter smooths, and predicts by the latency. No pictures are used.
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
    from capture.live.energy_kernels import FrameObservation, SolverModel

STEPS = 2
INITIAL_STEPS = 6
"""From a lifted pose, without a previous frame's."""
LIFT_EVERY = 60
"""Frames between lifted starts, which cost several times as much as both steps."""
_GAP_S = 0.3
"""Age from which the last pose is not used as a start."""
_TURNING_RAD_S, _MOVING_M_S = 3.0, 1.0
"""Typical speeds: what landmarks hardly determine, such as depth, stays about where it was."""
_POOR_FIT = 2.0
"""Times the typical energy from which a frame counts as badly fitted."""
_PIXEL_DEVIATION = 0.016
"""Of a landmark, in heights of the person."""
_WORLD_DEVIATION_M = 0.07
_FACE_DEPTH_WEIGHT = 0.3
_DAMPING = 1e-2
"""Share of the diagonal that is added; ten times more after a step that raised the energy."""
_DIAGONAL_FLOOR = 1e-6
_TYPICAL_SHARE = 0.1
"""Share of each frame in the running mean of the energy."""
_HANDS = slice(LANDMARK_NAMES.index("left_wrist"), LANDMARK_NAMES.index("right_thumb") + 1)
_EDGE = 0.1
"""Share of the picture's shorter side, from its edge on, over which the places of wrists and
fingers count less: the estimator puts a hand below the picture just inside it, and a forearm that
hangs down would reach forward by as much as it seems short."""
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
    """Tracks one person with one still camera; for one thread."""

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
            lifter: pose from a frame alone; `capture.detection.lifter.lift` for MediaPipe's
                landmarks.
            smoothing: None gives each frame's own solution.

        Raises InvalidInput for a negative latency.
        """
        if not 0.0 <= latency_s < 10.0:
            raise InvalidInput(f"latency_s must be between 0 and 10; got {latency_s!r}")
        self.latency_s, self._lifter = latency_s, lifter
        self.camera, self._rest = camera, body.skeleton.rest_joints
        self._to_world = camera.rotation.T @ np.diag(OPENCV_TO_OPENGL)
        self._model = solver_model(body, camera)
        self._filter = None if smoothing is None else PoseFilter(smoothing)
        self._last: _State | None = None
        self._time_s = -np.inf
        self._typical_energy, self._frames_since_lift = 0.0, 0
        self.landmark_weights: Float[Array, "33"] = np.zeros(len(LANDMARK_NAMES))
        """Of each landmark of the newest frame, 0 to 1."""

    def step(self, landmarks: Landmarks, time_s: float) -> Pose:
        """The pose at `time_s` + latency, from the landmarks of `time_s`.

        Raises InvalidInput where time does not advance or no landmark is visible.
        """
        if not time_s > self._time_s:
            raise InvalidInput(f"time_s must be later than {self._time_s}; got {time_s!r}")
        observation = frame_observation(landmarks, self.camera)
        state = self._solve_frame(landmarks, observation, time_s - self._time_s)
        self._last, self._time_s, self.landmark_weights = state, time_s, observation.weights
        root = state.pelvis - self._rest[0]
        if self._filter is None:
            return Pose(matrix_to_axis_angle(state.local), root, time_s)
        self._filter.add(state.local, root, time_s)
        return self._filter.pose(time_s + self.latency_s)

    def predict(self, time_s: float) -> Pose:
        """The pose at `time_s` without landmarks: a frame is lost, or the next is late."""
        if self._filter is None:
            raise InvalidInput(
                "predict must have a smoothing, which estimates velocities; got None"
            )
        return self._filter.pose(time_s + self.latency_s)

    def _solve_frame(
        self, landmarks: Landmarks, observation: FrameObservation, step_s: float
    ) -> _State:
        """The best pose for one frame, from the last one or from nothing."""
        found: list[_State] = []
        if self._last is not None and step_s < _GAP_S:
            start = self._last
            precision = np.full(UNKNOWNS, (_TURNING_RAD_S * step_s) ** -2)
            precision[3 * JOINT_COUNT :] = (_MOVING_M_S * step_s) ** -2
            found.append(self._refine(start.local, start.pelvis, observation, STEPS, precision))
        lost = not found
        self._frames_since_lift += 1
        if (
            lost
            or self._frames_since_lift >= LIFT_EVERY
            or found[0].energy > _POOR_FIT * self._typical_energy
        ):
            self._frames_since_lift = 0
            local, pelvis = self._lifted(landmarks, observation)
            steps, no_prior = INITIAL_STEPS if lost else STEPS, np.zeros(UNKNOWNS)
            found.append(self._refine(local, pelvis, observation, steps, no_prior))
        best = min(found, key=lambda one: one.energy)
        self._typical_energy += (1.0 if lost else _TYPICAL_SHARE) * (
            best.energy - self._typical_energy
        )
        return best

    def _lifted(
        self, landmarks: Landmarks, observation: FrameObservation
    ) -> tuple[Float[Array, "24 3 3"], Float[Array, "3"]]:
        """Local rotations by the lifter, and the pelvis' position from the landmarks."""
        from capture.live.gauss_newton_kernels import body_landmarks

        k, world, visibility = self.camera.intrinsics, landmarks.world, landmarks.visibility
        local = self._lifter(
            observation.pixels[None], world[None], visibility[None], self.camera.focal_px, k[:2, 2]
        ).rotations[0]
        local[0] = self._to_world @ local[0]
        points = body_landmarks(local, self._model) @ self.camera.rotation.T
        shift = solve_translation(
            points[None], observation.pixels[None], observation.pixel_weights[None], k
        )[0]
        return local, (shift - self.camera.translation) @ self.camera.rotation

    def _refine(
        self,
        local: Float[Array, "24 3 3"],
        pelvis: Float[Array, "3"],
        observation: FrameObservation,
        steps: int,
        precision: Float[Array, "75"],
    ) -> _State:
        """Damped Gauss-Newton steps; `precision` (1 / deviation^2) ties each unknown to its
        start."""
        from capture.live.gauss_newton_kernels import gauss_newton

        return _State(
            *gauss_newton(
                local, pelvis, self._model, observation, steps, precision, _DAMPING, _DIAGONAL_FLOOR
            )
        )


def frame_observation(landmarks: Landmarks, camera: Camera) -> FrameObservation:
    """One frame's landmarks as the kernels take them. Raises InvalidInput where nothing is seen."""
    from capture.live.energy_kernels import FrameObservation

    all_pixels, all_world, all_weights = landmark_arrays([landmarks], camera.width, camera.height)
    pixels, world, weights = all_pixels[0], all_world[0], all_weights[0]
    if not weights.any():
        raise InvalidInput("landmarks must show something inside the picture; got nothing")
    if camera.distortion is not None:
        k, distortion = camera.intrinsics, np.asarray(camera.distortion, dtype=np.float64)
        pixels = cv2.undistortPoints(pixels, k, distortion, P=k).reshape(pixels.shape)
    trunk_x, trunk_y = 0.5 * (pixels[_SHOULDERS] - pixels[_HIPS]).sum(axis=0)
    height_px = height_from_trunk_px(math.hypot(trunk_x, trunk_y))
    to_world = camera.rotation.T @ np.diag(OPENCV_TO_OPENGL)
    world_landmarks = np.ascontiguousarray((world * OPENCV_TO_OPENGL) @ to_world.T)
    return FrameObservation(
        np.ascontiguousarray(pixels),
        weights * _inside(landmarks, camera),
        weights,
        world_landmarks,
        1.0 / (_PIXEL_DEVIATION * height_px),
    )


def _inside(landmarks: Landmarks, camera: Camera) -> Float[Array, "33"]:
    """How far each landmark's place in the picture can be believed, from 0 to 1."""
    size = np.array([camera.width, camera.height])
    from_edge = np.minimum(landmarks.pixels, size - landmarks.pixels).min(axis=1)
    inside = np.ones(len(LANDMARK_NAMES))
    inside[_HANDS] = np.clip(from_edge / (_EDGE * size.min()), 0.0, 1.0)[_HANDS]
    return inside


def solver_model(body: Body, camera: Camera) -> SolverModel:
    """The kernels' constants: a body, its camera and the prior of poses."""
    from capture.body.pose_prior import pose_prior  # imports torch
    from capture.live.energy_kernels import SolverModel

    landmarks, joints = landmarks_on(body)
    prior, depth_weights = pose_prior(), np.ones(len(LANDMARK_NAMES))
    depth_weights[:FACE_LANDMARKS] = _FACE_DEPTH_WEIGHT
    return SolverModel(
        rest=np.array(body.skeleton.rest_joints),
        parents=np.array(PARENTS),
        landmarks=landmarks,
        joints=joints,
        hips=_HIPS,
        depth_weights=depth_weights,
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
