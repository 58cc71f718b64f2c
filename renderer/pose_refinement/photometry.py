"""Photometric normal equations: how a picture changes with the pose.

What a pixel shows moves by J d when the pose moves by d, so the picture there changes by -g J d
with g its gradient (Lucas & Kanade 1981; for articulated bodies Bregler & Malik 1998). g is the
mean of both pictures' gradients (Malis 2004, ESM): steps of second order at the price of the
first. Unlike in gradient descent, steps of wrists and hips are scaled by how much they move the
picture.

A pose moves by `POSE_PARAMETERS` = 75 numbers: rotations w of the 24 joints, each in its own frame
(rad; the new local rotation is R exp(w)), then a shift of the root (m, world). In own frames
a rotation that is constant over a clip is equivalent to another rest pose.

A clip shares `SHARED_PARAMETERS` numbers: logarithms of bone lengths, left and
right as one, then that of the focal length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scene.arrays import Array, Bool, Float, Int
from scene.camera import Camera
from scene.motion import Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_COUNT, JOINT_NAMES, Skeleton

POSE_PARAMETERS = 3 * JOINT_COUNT + 3
_BONES = [name for name in JOINT_NAMES[1:] if not name.startswith("right_")]
SHARED_PARAMETERS = len(_BONES) + 1
_DILATION_PX = 3
"""How far the silhouette is dilated: pixels beyond it are explained by the nearest point."""
_OUTLIER = 0.15
"""Scale of the robust loss of colour differences (Charbonnier)."""


@dataclass(frozen=True, eq=False)
class SkinnedPoints:
    """Rest points that follow the skeleton: N visible points of a body."""

    rest: Float[Array, "N 3"]
    joints: Array
    """[N 4] integers."""
    weights: Float[Array, "N 4"]


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Sum of squared differences about the pose: cost - 2 b.d + d.H.d; D = 75, or with what the
    clip shares 75 + SHARED_PARAMETERS."""

    matrix: Float[Array, "D D"]
    vector: Float[Array, "D"]
    cost: float


def apply_pose_step(pose: Pose, step: Float[Array, "75"]) -> Pose:
    """`pose` after `step`."""
    rotations = axis_angle_to_matrix(step[:-3].reshape(JOINT_COUNT, 3))
    angles = matrix_to_axis_angle(axis_angle_to_matrix(pose.joint_angles) @ rotations)
    root = pose.root_translation + step[-3:]
    return replace(pose, joint_angles=angles, root_translation=root)


def normal_equations(
    made: Float[Array, "H W 4"],
    truth: Float[Array, "H W 4"],
    front: Int[Array, "H W"],
    points: SkinnedPoints,
    skeleton: Skeleton,
    camera: Camera,
    pose: Pose,
    *,
    shared: bool = False,
) -> NormalEquations:
    """One Gauss-Newton step's equations for `pose`, where asked with what the clip shares.

    Args:
        made, truth: premultiplied colour and alpha.
        front: row of `points` that each pixel shows, -1 for none.
    """
    difference = made - truth
    front, covered = _dilate(front)
    rows, columns = np.nonzero(covered)
    r = difference[rows, columns]
    weight = (1.0 + (r**2).mean(axis=1) / _OUTLIER**2) ** -0.5
    g = 0.5 * (_gradient(made) + _gradient(truth))[rows, columns]  # [P 4 2]
    shown = front[rows, columns]
    jacobian = pixel_jacobian(points, shown, skeleton, camera, pose, shared=shared)  # [P 2 D]
    parameters = jacobian.shape[2]
    weighted = np.swapaxes(g, 1, 2) * weight[:, None, None]
    tensor, gradient = weighted @ g, weighted @ r[..., None]
    flat_jacobian = jacobian.reshape(-1, parameters)
    root = (_root(tensor) @ jacobian).reshape(-1, parameters)
    return NormalEquations(
        (root.T @ root).astype(np.float64),
        (flat_jacobian.T @ gradient.reshape(-1)).astype(np.float64),
        robust_cost(difference),
    )


def robust_cost(difference: Float[Array, "H W 4"]) -> float:
    """Sum over pixels of squared differences, linear where they are large."""
    squared = (difference**2).mean(axis=2) / _OUTLIER**2
    return float(8.0 * _OUTLIER**2 * (np.sqrt(1.0 + squared) - 1.0).sum())


def pixel_jacobian(
    points: SkinnedPoints,
    shown: Int[Array, "P"],
    skeleton: Skeleton,
    camera: Camera,
    pose: Pose,
    *,
    shared: bool = False,
) -> Float[Array, "P 2 D"]:
    """Pixels that the points `shown` move by a unit of each of the pose's numbers, then, where
    asked, of those that the clip shares."""
    skinning = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    transforms = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
    joints, weights = points.joints[shown].astype(np.int64), points.weights[shown]
    blended = np.einsum("ps,psij->pij", weights, skinning[joints][:, :, :3])
    world = (blended[:, :, :3] @ points.rest[shown][:, :, None])[..., 0] + blended[:, :, 3]
    dense = np.zeros((len(shown), JOINT_COUNT), np.float32)
    np.add.at(dense, (np.arange(len(shown))[:, None], joints), weights)
    share = dense @ descendants(skeleton).T.astype(np.float32)
    jacobian = pose_jacobian(
        world, _projection_jacobian(camera, world), share, transforms, skeleton if shared else None
    )
    if not shared:
        return jacobian
    offset = camera.project(world)[0] - camera.intrinsics[:2, 2]
    return np.concatenate([jacobian, offset[:, :, None].astype(np.float32)], axis=2)


def pose_jacobian(
    world: Float[Array, "P 3"],
    by_position: Float[Array, "P R 3"],
    share: Float[Array, "P 24"],
    transforms: Float[Array, "24 4 4"],
    stretching: Skeleton | None,
) -> Float[Array, "P R D"]:
    """Jacobian of R functions of each point by the pose's parameters, then, with a skeleton for
    `stretching`, by the bone lengths that the clip shares; float32.

    `by_world` is what they change by as the point moves; `share`, how much of it follows each
    joint; `places`, where the joints are.
    """
    # a rotation w of joint k about c moves x by w x (x - c): a.(w x (x - c)) = w.(x x a) - w.(c x
    # a)
    about = np.cross(world[:, None], by_position)
    frames = transforms[:, :3, :3]
    lever = np.stack([_cross(transforms[k, :3, 3]).T @ frames[k] for k in range(JOINT_COUNT)])
    basis = np.concatenate([frames, -lever], axis=1)  # [K 6 3]
    basis = np.moveaxis(basis, 0, 1).reshape(6, -1)
    by_joint = np.concatenate([about, by_position], axis=2).astype(np.float32) @ basis.astype(
        np.float32
    )
    by_rotation = by_joint * np.repeat(share, 3, axis=1)[:, None]
    parts = [by_rotation, by_position.astype(np.float32)]
    if stretching is not None:
        bones = by_position.astype(np.float32) @ _bones(stretching, transforms).T.astype(np.float32)
        parts.append((bones * share[:, None, 1:]) @ _SHARED_BONES)
    return np.concatenate(parts, axis=2)


def with_bone_lengths(skeleton: Skeleton, step: Float[Array, "SHARED_PARAMETERS"]) -> Skeleton:
    """`skeleton` with its bones longer by the `step` of what the clip shares."""
    rest, ratios = skeleton.rest_joints.copy(), np.exp(_SHARED_BONES @ step[:-1])
    for child, parent in enumerate(skeleton.parents[1:], 1):
        bone = skeleton.rest_joints[child] - skeleton.rest_joints[parent]
        rest[child] = rest[parent] + ratios[child - 1] * bone
    return replace(skeleton, rest_joints=rest)


def log_bone_ratios(first: Skeleton, second: Skeleton) -> Float[Array, "SHARED_PARAMETERS"]:
    """The step by which `with_bone_lengths` makes `second` of `first`."""
    lengths = [
        np.linalg.norm(s.rest_joints[1:] - s.rest_joints[list(s.parents[1:])], axis=1)
        for s in (first, second)
    ]
    longer = np.log(np.maximum(lengths[1], 1e-9) / np.maximum(lengths[0], 1e-9))
    return np.append(longer @ _SHARED_BONES / _SHARED_BONES.sum(axis=0), 0.0)


def descendants(skeleton: Skeleton) -> Float[Array, "K K"]:
    """Row k is 1 for k itself and every joint below it."""
    below = np.eye(len(skeleton.parents))
    for child in range(len(skeleton.parents) - 1, 0, -1):
        below[skeleton.parents[child]] += below[child]
    return below


def _bones(skeleton: Skeleton, transforms: Float[Array, "K 4 4"]) -> Float[Array, "N 3"]:
    """From each joint's parent to the joint, in the world, m; the root has none."""
    parents = transforms[list(skeleton.parents[1:]), :3, 3]
    return transforms[1:, :3, 3] - parents


def _shared_bones() -> Float[Array, "N B"]:
    """Which of the shared lengths is each joint's bone's: left and right have one."""
    names = [name.replace("right_", "left_") for name in JOINT_NAMES[1:]]
    return np.array([[float(name == bone) for bone in _BONES] for name in names], np.float32)


_SHARED_BONES = _shared_bones()


def _projection_jacobian(camera: Camera, world: Float[Array, "P 3"]) -> Float[Array, "P 2 3"]:
    """Jacobian of the pixel by the position in the world, px/m."""
    rotation, shift = camera.world_to_camera[:, :3], camera.world_to_camera[:, 3]
    in_camera = world @ rotation.T + shift
    depth = np.maximum(in_camera[:, 2], 0.05)
    fx, fy = camera.intrinsics[0, 0], camera.intrinsics[1, 1]
    local = np.zeros((len(world), 2, 3))
    local[:, 0, 0], local[:, 1, 1] = fx / depth, fy / depth
    local[:, 0, 2] = -fx * in_camera[:, 0] / depth**2
    local[:, 1, 2] = -fy * in_camera[:, 1] / depth**2
    return local @ rotation


def _dilate(front: Int[Array, "H W"]) -> tuple[Int[Array, "H W"], Bool[Array, "H W"]]:
    """`front` dilated by a few pixels, and where it is defined."""
    grown = front.copy()
    for _ in range(_DILATION_PX):
        padded = np.pad(grown, 1, constant_values=-1)
        around = (padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:])
        grown = np.where(grown >= 0, grown, np.maximum.reduce(around))
    return grown, grown >= 0


def _gradient(picture: Float[Array, "H W 4"]) -> Float[Array, "H W 4 2"]:
    """Central differences along x and y, 1/px."""
    padded = np.pad(picture, ((1, 1), (1, 1), (0, 0)), mode="edge")
    along_x = 0.5 * (padded[1:-1, 2:] - padded[1:-1, :-2])
    along_y = 0.5 * (padded[2:, 1:-1] - padded[:-2, 1:-1])
    return np.stack([along_x, along_y], axis=3)


def _root(tensor: Float[Array, "P 2 2"]) -> Float[Array, "P 2 2"]:
    """U with U^T U = tensor (2x2, positive semi-definite), as float32."""
    a = np.sqrt(np.maximum(tensor[:, 0, 0], 1e-20))
    b = tensor[:, 0, 1] / a
    root = np.zeros(tensor.shape, np.float32)
    root[:, 0, 0], root[:, 0, 1] = a, b
    root[:, 1, 1] = np.sqrt(np.maximum(tensor[:, 1, 1] - b**2, 0.0))
    return root


def _cross(v: Float[Array, "3"]) -> Float[Array, "3 3"]:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
