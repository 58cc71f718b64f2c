"""A learnt lifter from landmarks to joint rotations, which corrects closed-form kinematics.

The estimator's 3D landmarks flatten people in depth, each pose in its own way. A small network
(two residual blocks, as in Martinez et al. 2017, "A simple yet effective baseline for 3D human pose
estimation") takes them, the 2D landmarks and the closed-form rotations, and rotates each of
these. It is trained on rendered people in random poses (`tools.build_lifter`), and predicts its
own error. Numpy only; frames are independent, so any frame rate will do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL, solve_pose
from capture.body.landmark_names import LANDMARK_COUNT
from scene.arrays import Array, Float
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import JOINT_COUNT, PARENTS

WEIGHTS_FILE = Path(__file__).parents[1] / "assets" / "lifter.npz"
BLOCKS = 2
FEATURES = LANDMARK_COUNT * (2 + 3 + 1 + 3 + 3) + 1 + 6 * (JOINT_COUNT - 1) + 9
OUTPUTS = 7 * JOINT_COUNT
"""Two columns of a rotation and the logarithm of a spread for each joint."""
_CLOSED_FORM_SPREAD_RAD = 0.45
_CLIP_DEVIATIONS = 6.0
"""Deviations from the centre at which landmarks (guesses outside the picture) are clipped."""
_MIN_VISIBILITY = 0.02
_MIN_SIZE = 1e-6
_NORMALISATION_EPS = 1e-5


@dataclass(frozen=True, eq=False)
class Lifted:
    """Poses and their predicted error."""

    rotations: Float[Array, "F 24 3 3"]
    """Local; joint 0's is relative to axes y up, z towards the camera."""
    spread_rad: Float[Array, "F 24"]
    """Root mean square angle of error of each joint's rotation."""


@dataclass(frozen=True, eq=False)
class Inputs:
    """Input of the network, and the rotations that its output is relative to."""

    features: Float[Array, "F N"]
    closed_form: Float[Array, "F 24 3 3"]
    """World rotations of the closed form, axes of the view through the person."""
    view: Float[Array, "F 3 3"]
    """Camera axes to those whose z goes through the person, x right, y down, z away."""


Lifter = Callable[[Array, Array, Array, float, Array], Lifted]
"""As `lift`."""


def closed_form(
    pixels: Float[Array, "F 33 2"],
    world: Float[Array, "F 33 3"],
    visibility: Float[Array, "F 33"],
    focal_px: float,
    centre: Float[Array, "2"],
) -> Lifted:
    """Closed-form kinematics of the 3D landmarks: for estimators the network was not trained on."""
    rotations = axis_angle_to_matrix(solve_pose(world, visibility))
    return Lifted(rotations, np.full(rotations.shape[:2], _CLOSED_FORM_SPREAD_RAD))


def lift(
    pixels: Float[Array, "F 33 2"],
    world: Float[Array, "F 33 3"],
    visibility: Float[Array, "F 33"],
    focal_px: float,
    centre: Float[Array, "2"],
) -> Lifted:
    """Poses of one person from the estimator's landmarks (px; m, x right, y down).

    `visibility` is the estimator's own, 0 to 1; `focal_px` and `centre` are the camera's.
    """
    inputs = inputs_of(pixels, world, visibility, focal_px, centre)
    output = _network(inputs.features)
    view_rotations = inputs.closed_form @ _orthonormal(output[:, : 6 * JOINT_COUNT])
    view_to_camera = np.swapaxes(inputs.view, 1, 2) * OPENCV_TO_OPENGL[:, None] * OPENCV_TO_OPENGL
    local = (view_to_camera[:, None] @ view_rotations).copy()
    global_rotations = local.copy()
    for joint in range(1, JOINT_COUNT):
        parent = global_rotations[:, PARENTS[joint]]
        local[:, joint] = np.swapaxes(parent, 1, 2) @ global_rotations[:, joint]
    return Lifted(local, np.exp(output[:, 6 * JOINT_COUNT :]))


def inputs_of(
    pixels: Float[Array, "F 33 2"],
    world: Float[Array, "F 33 3"],
    visibility: Float[Array, "F 33"],
    focal_px: float | Float[Array, "F"],
    centre: Float[Array, "2"],
) -> Inputs:
    """Features: landmarks in the picture and in 3D, in the view's axes and in the body's own."""
    frames = len(pixels)
    plane = (pixels - centre) / np.asarray(focal_px, dtype=np.float64).reshape(-1, 1, 1)
    weights = np.clip(visibility, _MIN_VISIBILITY, 1.0)[..., None] ** 2
    total = weights.sum(axis=1)
    view = _view_through((plane * weights).sum(axis=1) / total)
    rays = np.concatenate([plane, np.ones_like(plane[..., :1])], 2) @ np.swapaxes(view, 1, 2)
    normalised = rays[..., :2] / np.maximum(rays[..., 2:], 0.2)
    size = np.sqrt((weights * normalised**2).sum(axis=(1, 2))[:, None] / total) + _MIN_SIZE
    normalised = np.clip(normalised / size[..., None], -_CLIP_DEVIATIONS, _CLIP_DEVIATIONS)
    local = axis_angle_to_matrix(solve_pose(world, visibility))
    global_rotations = local.copy()
    for joint in range(1, JOINT_COUNT):
        global_rotations[:, joint] = global_rotations[:, PARENTS[joint]] @ local[:, joint]
    body = global_rotations[:, 0]
    flat = np.concatenate(
        [normalised * OPENCV_TO_OPENGL[:2], np.zeros_like(normalised[..., :1])], 2
    )
    parts = (
        normalised,
        2.0 * world,
        visibility,
        np.log(size),
        2.0 * (world * OPENCV_TO_OPENGL) @ body,
        flat @ body,
        local[:, 1:, :, :2],
        body,
    )
    features = np.concatenate([part.reshape(frames, -1) for part in parts], axis=1)
    return Inputs(features.astype(np.float32), global_rotations, view)


def _view_through(middle: Float[Array, "F 2"]) -> Float[Array, "F 3 3"]:
    """Rows: axes of a view whose z goes through `middle` on the plane z = 1, x level."""
    z = np.concatenate([middle, np.ones((len(middle), 1))], axis=1)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = np.cross(np.array([[0.0, 1.0, 0.0]]), z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _orthonormal(six: Float[Array, "F 144"]) -> Float[Array, "F 24 3 3"]:
    """Rotations whose first two columns are nearest (Zhou et al. 2019); zeros give the identity."""
    pair = six.reshape(-1, JOINT_COUNT, 2, 3) + np.eye(3, dtype=six.dtype)[:2]
    a = pair[..., 0, :] / np.linalg.norm(pair[..., 0, :], axis=-1, keepdims=True)
    b = pair[..., 1, :] - np.sum(a * pair[..., 1, :], axis=-1, keepdims=True) * a
    b = b / np.linalg.norm(b, axis=-1, keepdims=True)
    return np.stack([a, b, np.cross(a, b)], axis=-1)


def _network(features: Float[Array, "F N"]) -> Float[Array, "F M"]:
    weights = _weights()

    def linear(name: str, x: Array) -> Array:
        return x @ weights[f"{name}.weight"].T + weights[f"{name}.bias"]

    def normalised(name: str, x: Array) -> Array:
        x = x - x.mean(axis=1, keepdims=True)
        x = x / np.sqrt((x**2).mean(axis=1, keepdims=True) + _NORMALISATION_EPS)
        return x * weights[f"{name}.weight"] + weights[f"{name}.bias"]

    hidden = _silu(linear("first", (features - weights["mean"]) / weights["deviation"]))
    for block in range(BLOCKS):
        inner = hidden
        for half in range(2):
            name = f"blocks.{block}.{half}"
            inner = _silu(normalised(f"{name}.norm", linear(f"{name}.linear", inner)))
        hidden = hidden + inner
    return linear("last", hidden).astype(np.float64)


def _silu(x: Array) -> Array:
    return x / (1.0 + np.exp(-np.clip(x, -80.0, 80.0)))


@cache
def _weights() -> dict[str, Float[Array, "*shape"]]:
    with np.load(WEIGHTS_FILE) as file:
        return {name: file[name].astype(np.float32) for name in file.files}
