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

from renderer.splats.rasteriser.workspace import pack_camera
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
    g = _gradient(0.5 * (made + truth))[rows, columns]  # [P 4 2]
    weighted = np.swapaxes(g, 1, 2) * weight[:, None, None]
    matrix, vector = pixel_equations(
        points,
        front[rows, columns],
        weighted @ g,
        (weighted @ r[..., None])[..., 0],
        skeleton,
        camera,
        pose,
        shared=shared,
    )
    return NormalEquations(matrix, vector, robust_cost(difference))


def robust_cost(difference: Float[Array, "H W 4"]) -> float:
    """Sum over pixels of squared differences, linear where they are large."""
    squared = (difference**2).mean(axis=2) / _OUTLIER**2
    return float(8.0 * _OUTLIER**2 * (np.sqrt(1.0 + squared) - 1.0).sum())


def pixel_equations(
    points: SkinnedPoints,
    shown: Int[Array, "P"],
    tensors: Float[Array, "P 2 2"],
    gradients: Float[Array, "P 2"],
    skeleton: Skeleton,
    camera: Camera,
    pose: Pose,
    *,
    shared: bool = False,
) -> tuple[Float[Array, "D D"], Float[Array, "D"]]:
    """Sums over pixels of J^T T J and J^T g: J are the pixels that the points `shown` move by a
    unit of each of the pose's numbers, then, where asked, of those that the clip shares.

    Args:
        tensors: T, symmetric.
        gradients: g.
    """
    import numba

    from renderer.pose_refinement.photometry_kernels import OWN, by_numbers, sum_pixels

    threads = numba.get_num_threads()
    matrices = np.zeros((threads, JOINT_COUNT, JOINT_COUNT, OWN * OWN))
    vectors = np.zeros((threads, JOINT_COUNT, OWN))
    sum_pixels(
        tensors.astype(np.float64),
        gradients.astype(np.float64),
        points.rest[shown].astype(np.float32),
        points.joints[shown].astype(np.uint8),
        points.weights[shown].astype(np.float32),
        skeleton.skinning_transforms(pose.joint_angles, pose.root_translation),
        pack_camera(camera),
        matrices,
        vectors,
    )
    bases = _bases(skeleton, pose, shared=shared)
    matrix, vector = np.zeros((bases.shape[2], bases.shape[2])), np.zeros(bases.shape[2])
    by_numbers(matrices, vectors, bases, matrix, vector)
    return matrix, vector


def _bases(skeleton: Skeleton, pose: Pose, *, shared: bool) -> Float[Array, "24 7 D"]:
    """How points that a joint carries move by a unit of each number: rotation about the world's
    origin, shift, and the focal length's logarithm."""
    transforms = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)
    own = np.zeros((JOINT_COUNT, 7, POSE_PARAMETERS + (SHARED_PARAMETERS if shared else 0)))
    for k, transform in enumerate(transforms):
        axes = transform[:3, :3]
        own[k, :3, 3 * k : 3 * k + 3] = axes
        own[k, 3:6, 3 * k : 3 * k + 3] = np.cross(transform[:3, 3], axes, axis=0)
    own[0, 3:6, POSE_PARAMETERS - 3 : POSE_PARAMETERS] = np.eye(3)
    if shared:
        bones = _bones(skeleton, transforms)
        own[1:, 3:6, POSE_PARAMETERS:-1] = bones[:, :, None] * _SHARED_BONES[:, None]
        own[0, 6, -1] = 1.0
    # a joint moves by what moves those above it, too
    for joint, parent in enumerate(skeleton.parents[1:], 1):
        own[joint] += own[parent]
    return own


def pose_jacobian(
    world: Float[Array, "P 3"],
    by_position: Float[Array, "P 3"],
    share: Float[Array, "P 24"],
    transforms: Float[Array, "24 4 4"],
) -> Float[Array, "P 75"]:
    """Jacobian of a function of each point by the pose's parameters.

    Args:
        by_position: what it changes by as the point moves.
        share: how much of the point follows each joint.
        transforms: of the joints, to the world.
    """
    arms = world[:, None] - transforms[:, :3, 3]
    about = np.cross(arms, by_position[:, None]) * share[..., None]
    by_rotation = np.einsum("pki,kij->pkj", about, transforms[:, :3, :3])
    return np.concatenate([by_rotation.reshape(len(world), -1), by_position], axis=1)


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


def _dilate(front: Int[Array, "H W"]) -> tuple[Int[Array, "H W"], Bool[Array, "H W"]]:
    """`front` dilated by a few pixels, and where it is defined."""
    import cv2

    # single precision holds every row's number
    grown, cross = front.astype(np.float32), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    for _ in range(_DILATION_PX):
        grown = np.where(grown >= 0.0, grown, cv2.dilate(grown, cross))
    grown = grown.astype(np.int32)
    return grown, grown >= 0


def _gradient(picture: Float[Array, "H W 4"]) -> Float[Array, "H W 4 2"]:
    """Central differences along x and y, 1/px."""
    padded = np.pad(picture, ((1, 1), (1, 1), (0, 0)), mode="edge")
    along_x = 0.5 * (padded[1:-1, 2:] - padded[1:-1, :-2])
    along_y = 0.5 * (padded[2:, 1:-1] - padded[:-2, 1:-1])
    return np.stack([along_x, along_y], axis=3)
