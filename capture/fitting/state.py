"""What the fit optimises, and the body that it makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL, solve_translation
from capture.body.landmark_names import LANDMARK_COUNT
from capture.body.landmarks import MIRROR, place_landmarks
from capture.body.model import BodyModel
from capture.fitting.kinematics import (
    BlendWeights,
    PosedBody,
    forward_kinematics,
    project,
    rotation_matrices,
    skinned_points,
)
from capture.fitting.observations import Observations
from capture.fitting.surface import SurfaceSamples
from scene.arrays import Array, Bool, Float, Int, Tensor
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_COUNT

_SURFACE_SPACING_M = 0.065


@dataclass(eq=False)
class FitState:
    """The unknowns of one clip: SMPL's theta, translation and beta, and a few of the recording.

    All but `root_rotations` and `frame_confidence` are optimised.
    """

    root_rotations: Float[Tensor, "F 3 3"]
    """Where the root's rotations start; they are changed by `joint_angles[:, 0]`."""
    joint_angles: Float[Tensor, "F 24 3"]
    """Axis-angle, rad, relative to the parent."""
    pelvis: Float[Tensor, "F 3"]
    """Position of joint 0, m."""
    shape: Float[Tensor, "B"]
    log_focal: Float[Tensor, ""]
    """Of the focal length over the observations'."""
    log_landmark_scale: Float[Tensor, ""]
    """Of the estimator's 3D landmarks, whose size is a guess."""
    clothing_m: Float[Tensor, ""]
    """Distance of outlines from the skin."""
    lifter_bias: Float[Tensor, "24 3"]
    """Constant rotations (rad) of this person's joints relative to the lifter's poses."""
    landmark_offsets: Float[Tensor, "33 3"]
    """m, of the person's landmarks from the body model's, at rest."""
    floor_plane: Float[Tensor, "3"]
    """y = a x + b z + c about `floor_origin`, m."""
    floor_origin: Float[Tensor, "3"] | None
    """m; None until a floor was found."""
    tilt: Float[Tensor, "2"]
    """Slopes of the vertical in the camera frame: x / y and z / y."""
    frame_confidence: Float[Tensor, "F"]
    """Weight of the estimator's landmarks of each frame, 0 to 1."""

    @property
    def up(self) -> Float[Tensor, "3"]:
        """The vertical (unit) in the camera frame."""
        x, z = self.tilt
        return torch.stack([x, torch.ones_like(x), z]) / (1.0 + x * x + z * z).sqrt()

    def local_rotations(self) -> Float[Tensor, "F 24 3 3"]:
        """Rotations relative to the parent; joint 0's to the camera frame."""
        local = rotation_matrices(self.joint_angles)
        return torch.cat([(self.root_rotations @ local[:, 0])[:, None], local[:, 1:]], 1)

    @torch.no_grad()
    def set_poses(
        self, frames: Int[Array, "N"], angles: Float[Array, "N 24 3"], pelvis: Float[Array, "N 3"]
    ) -> None:
        """Replace the poses of `frames`; `angles` (rad) are whole, the root's too."""
        body = torch.tensor(angles, dtype=torch.float32)
        self.root_rotations[frames] = rotation_matrices(body[:, 0])
        body[:, 0] = 0.0
        self.joint_angles[frames] = body
        self.pelvis[frames] = torch.tensor(pelvis, dtype=torch.float32)

    @torch.no_grad()
    def whole_angles(self) -> Float[Array, "F 24 3"]:
        """Axis-angle (rad) of `local_rotations`, the root's start included."""
        return matrix_to_axis_angle(self.local_rotations().numpy().astype(np.float64))


class FitBody:
    """The body model as tensors: joints, landmarks and surface at rest, a unit of each shape."""

    def __init__(self, model: BodyModel) -> None:
        landmarks = place_landmarks(model)
        self.model = model
        self.joints, self.joint_directions = (
            torch.tensor(value, dtype=torch.float32)
            for value in (model.rest_joints, model.joint_directions)
        )
        self.landmarks, self.landmark_directions = (
            torch.tensor(value, dtype=torch.float32)
            for value in (landmarks.rest, landmarks.directions)
        )
        self.landmark_joints = BlendWeights.rigid(landmarks.joints)
        self.surface = SurfaceSamples.spread(model, _SURFACE_SPACING_M)
        self._mirror = torch.tensor(MIRROR)

    def rest_landmarks(self, state: FitState) -> Float[Tensor, "33 3"]:
        """The person's landmarks at rest, m; their offsets are symmetric."""
        mirrored = state.landmark_offsets[self._mirror] * torch.tensor([-1.0, 1.0, 1.0])
        own = 0.5 * (state.landmark_offsets + mirrored)
        return self.landmarks + self.landmark_directions @ state.shape + own


class PosedClip:
    """The body as one state poses it in every frame; terms share what it computes.

    Each part is computed when first asked for. Gradients reach the state, unless it is made and
    asked under `torch.no_grad`.
    """

    def __init__(self, state: FitState, body: FitBody, seen: Observations) -> None:
        self.state, self.body, self.seen = state, body, seen

    @cached_property
    def local_rotations(self) -> Float[Tensor, "F 24 3 3"]:
        """As of `FitState`."""
        return self.state.local_rotations()

    @cached_property
    def posed(self) -> PosedBody:
        state, body = self.state, self.body
        rest = body.joints + body.joint_directions @ state.shape
        rotations, positions = forward_kinematics(self.local_rotations, state.pelvis, rest)
        return PosedBody(rotations, positions, rest, state.shape)

    @cached_property
    def focal_px(self) -> Float[Tensor, ""]:
        return self.seen.focal_px * torch.exp(self.state.log_focal)

    @cached_property
    def landmarks(self) -> Float[Tensor, "F 33 3"]:
        """m."""
        rest = self.body.rest_landmarks(self.state)
        return skinned_points(self.posed, rest, self.body.landmark_joints)

    @cached_property
    def reprojection_error_px(self) -> Float[Tensor, "F 33 2"]:
        """From each seen landmark to the body's, px."""
        return self.project(self.landmarks) - self.seen.landmarks_px

    @cached_property
    def surface(self) -> Float[Tensor, "F V 3"]:
        """Vertices spread over the body, m."""
        return self.body.surface.posed(self.posed)

    @cached_property
    def surface_px(self) -> Float[Tensor, "F V 2"]:
        return self.project(self.surface)

    def project(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2"]:
        """Pixels of `points` (m)."""
        return project(points, self.focal_px, self.seen.centre)


def initial_state(body: FitBody, seen: Observations) -> FitState:
    """The lifter's poses, where their landmarks fit the seen ones best, on the usual shape."""
    rotations = seen.lifted_rotations
    frames = len(rotations)
    angles = torch.tensor(
        matrix_to_axis_angle(rotations.numpy().astype(np.float64)), dtype=torch.float32
    )
    root = torch.tensor(
        axis_angle_to_matrix(angles[:, 0].numpy().astype(np.float64)), dtype=torch.float32
    )
    angles[:, 0] = 0.0
    return FitState(
        root,
        angles.requires_grad_(),
        torch.tensor(_initial_pelvis(body, seen), dtype=torch.float32).requires_grad_(),
        torch.zeros(body.model.shape_count, requires_grad=True),
        torch.zeros((), requires_grad=True),
        torch.zeros((), requires_grad=True),
        torch.zeros((), requires_grad=True),
        torch.zeros(JOINT_COUNT, 3, requires_grad=True),
        torch.zeros(LANDMARK_COUNT, 3, requires_grad=True),
        torch.zeros(3, requires_grad=True),
        None,
        _initial_tilt(seen).requires_grad_(),
        torch.ones(frames),
    )


def _initial_tilt(seen: Observations) -> Float[Tensor, "2"]:
    """Level, where the scene doesn't tell."""
    return torch.zeros(2) if seen.up is None else seen.up[[0, 2]] / seen.up[1]


@torch.no_grad()
def _initial_pelvis(body: FitBody, seen: Observations) -> Float[Array, "F 3"]:
    origin = torch.zeros(len(seen.lifted_rotations), 3)
    rotations, positions = forward_kinematics(seen.lifted_rotations, origin, body.joints)
    posed = PosedBody(rotations, positions, body.joints, torch.zeros(body.model.shape_count))
    landmarks = skinned_points(posed, body.landmarks, body.landmark_joints)
    focal, (x, y) = seen.focal_px, seen.centre.tolist()
    intrinsics = np.array([[focal, 0.0, x], [0.0, focal, y], [0.0, 0.0, 1.0]])
    points = landmarks.numpy().astype(np.float64) * OPENCV_TO_OPENGL
    pixels, weights = (
        value.numpy().astype(np.float64) for value in (seen.landmarks_px, seen.landmark_weights)
    )
    return solve_translation(points, pixels, weights, intrinsics) * OPENCV_TO_OPENGL


def outlying(energies: Float[Array, "F"], factor: float) -> Bool[Array, "F"]:
    """Frames whose energy is more than `factor` times the clip's median."""
    return energies > factor * np.median(energies)
