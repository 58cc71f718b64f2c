"""Closed-form inverse kinematics: 33 landmarks in 3D to the joint angles of the 24-joint body.

Axes: y up, z towards the camera, x to the right of the picture, so that a person who faces the
camera faces +z as at rest. The head is placed by the best rotation between rest and seen landmarks
(Kabsch), the trunk by hips and shoulders, limbs by the directions of their two bones and the axis
of the hinge between them. Pure functions, batched over frames.
"""

from __future__ import annotations

import numpy as np

from capture.body.landmark_names import FACE_LANDMARKS, LANDMARK_NAMES
from capture.body.landmarks import load_body_landmarks
from scene.arrays import Array, Float
from scene.limits import ELBOW_HINGE
from scene.rotations import (
    axis_angle_to_matrix,
    matrix_to_axis_angle,
    rotation_between,
)
from scene.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS

OPENCV_TO_OPENGL = np.array([1.0, -1.0, -1.0])
"""Axes of OpenCV's and MediaPipe's cameras (x right, y down, z away) to OpenGL's (y up, z towards
the viewer), and back."""
VISIBLE = 0.5
"""Visibility from which a limb's landmarks are used; below, the limb stays at rest."""
_BENT_FROM, _FULLY_BENT = 0.15, 0.5
"""Sine of the bend between which the hinge's axis goes from the parent's to the seen one."""

_J = {name: index for index, name in enumerate(JOINT_NAMES)}
_L = {name: index for index, name in enumerate(LANDMARK_NAMES)}
_HEAD = list(range(FACE_LANDMARKS))
_TRUNK = [_L[n] for n in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")]


def solve_pose(
    landmarks: Float[Array, "*batch 33 3"], visibility: Float[Array, "*batch 33"] | None = None
) -> Float[Array, "*batch 24 3"]:
    """Joint angles (axis-angle, rad) of the body seen as `landmarks` (m, MediaPipe's world axes).

    Only directions count, so any body size will do. Joint 0 is the global orientation. Limbs
    whose landmarks have `visibility` below 0.5 hang straight (legs) or along the body (arms).
    """
    points = np.asarray(landmarks, dtype=np.float64) * OPENCV_TO_OPENGL
    batch = points.shape[:-2]
    points = points.reshape(-1, len(LANDMARK_NAMES), 3)
    visible = np.ones(points.shape[:2], dtype=bool)
    if visibility is not None:
        visible = np.asarray(visibility).reshape(visible.shape) >= VISIBLE
    world = np.tile(np.eye(3), (len(points), JOINT_COUNT, 1, 1))
    _solve_trunk(points, world)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        _solve_arm(points, visible, world, side, sign)
        _solve_leg(points, visible, world, side)
    local = world.copy()
    for joint in range(1, JOINT_COUNT):
        local[:, joint] = np.swapaxes(world[:, PARENTS[joint]], -1, -2) @ world[:, joint]
    return matrix_to_axis_angle(local).reshape(*batch, JOINT_COUNT, 3)


def solve_translation(
    points: Float[Array, "F N 3"],
    pixels: Float[Array, "F N 2"],
    weights: Float[Array, "F N"],
    intrinsics: Float[Array, "3 3"],
) -> Float[Array, "F 3"]:
    """The shift that makes `points` (m, camera frame) project onto `pixels`, by least squares.

    From u (z + tz) = x + tx and v (z + tz) = y + ty on the plane z = 1: linear in the shift.
    """
    plane = (pixels - intrinsics[:2, 2]) / np.diag(intrinsics)[:2]
    root = np.sqrt(weights)[..., None, None]
    rows = np.zeros((*points.shape[:2], 2, 3))
    rows[..., 0, 0] = rows[..., 1, 1] = 1.0
    rows[..., 2] = -plane
    right = (plane * points[..., 2:] - points[..., :2])[..., None]
    a = (root * rows).reshape(len(points), -1, 3)
    b = (root * right).reshape(len(points), -1, 1)
    normal = np.swapaxes(a, 1, 2) @ a + 1e-9 * np.eye(3)
    return np.linalg.solve(normal, np.swapaxes(a, 1, 2) @ b)[..., 0]


def _solve_trunk(points: Array, world: Array) -> None:
    rest = load_body_landmarks().rest
    hips = _frame(points[:, _TRUNK[2]] - points[:, _TRUNK[3]], _trunk_up(points))
    chest = _frame(points[:, _TRUNK[0]] - points[:, _TRUNK[1]], _trunk_up(points))
    head = _kabsch(rest[_HEAD], points[:, _HEAD])
    world[:, _J["pelvis"]] = hips
    twist = matrix_to_axis_angle(np.swapaxes(hips, -1, -2) @ chest)
    for fraction, name in ((1 / 3, "spine1"), (2 / 3, "spine2"), (1.0, "spine3")):
        world[:, _J[name]] = hips @ axis_angle_to_matrix(fraction * twist)
    for name in ("left_collar", "right_collar"):
        world[:, _J[name]] = chest
    nod = matrix_to_axis_angle(np.swapaxes(chest, -1, -2) @ head)
    world[:, _J["neck"]] = chest @ axis_angle_to_matrix(0.5 * nod)
    world[:, _J["head"]] = head


def _trunk_up(points: Array) -> Array:
    shoulders = points[:, _TRUNK[0]] + points[:, _TRUNK[1]]
    return shoulders - points[:, _TRUNK[2]] - points[:, _TRUNK[3]]


def _solve_arm(points: Array, visible: Array, world: Array, side: str, sign: float) -> None:
    shoulder, elbow, wrist = (_L[f"{side}_{n}"] for n in ("shoulder", "elbow", "wrist"))
    along = np.array([sign, 0.0, 0.0])
    hinge = np.array(ELBOW_HINGE[side])
    chest = world[:, _J[f"{side}_collar"]]
    upper_arm = points[:, elbow] - points[:, shoulder]
    fore_arm = points[:, wrist] - points[:, elbow]
    hanging = chest @ rotation_between(along, np.array([0.0, -1.0, 0.0]))
    upper, fore = _two_bones(chest, upper_arm, fore_arm, along, hinge)
    arm_visible = visible[:, elbow][:, None, None]
    forearm_visible = (visible[:, elbow] & visible[:, wrist])[:, None, None]
    upper = np.where(arm_visible, upper, hanging)
    fore = np.where(forearm_visible, fore, upper)
    index, pinky = points[:, _L[f"{side}_index"]], points[:, _L[f"{side}_pinky"]]
    fingers = 0.5 * (index + pinky) - points[:, wrist]
    hand = _frame(sign * fingers, np.cross(index - pinky, sign * fingers))
    hand = np.where(forearm_visible, _limit_angle(fore, hand, 1.2), fore)
    # a rotated palm rotates the forearm too: half of the twist belongs to the elbow
    twist = matrix_to_axis_angle(np.swapaxes(fore, -1, -2) @ hand) * [0.5, 0.0, 0.0]
    world[:, _J[f"{side}_shoulder"]] = upper
    world[:, _J[f"{side}_elbow"]] = fore @ axis_angle_to_matrix(twist)
    world[:, _J[f"{side}_wrist"]] = world[:, _J[f"{side}_hand"]] = hand


def _solve_leg(points: Array, visible: Array, world: Array, side: str) -> None:
    hip, knee, ankle = (_L[f"{side}_{n}"] for n in ("hip", "knee", "ankle"))
    along, hinge = np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    pelvis = world[:, _J["pelvis"]]
    thigh, shin = _two_bones(
        pelvis, points[:, knee] - points[:, hip], points[:, ankle] - points[:, knee], along, hinge
    )
    thigh_visible = visible[:, knee][:, None, None]
    shin_visible = (visible[:, knee] & visible[:, ankle])[:, None, None]
    thigh = np.where(thigh_visible, thigh, pelvis)
    shin = np.where(shin_visible, shin, thigh)
    heel, toe = _L[f"{side}_heel"], _L[f"{side}_foot_index"]
    rest = load_body_landmarks().rest
    foot = _swing(shin, rest[toe] - rest[heel], points[:, toe] - points[:, heel])
    foot_visible = shin_visible & (visible[:, heel] & visible[:, toe])[:, None, None]
    world[:, _J[f"{side}_hip"]] = thigh
    world[:, _J[f"{side}_knee"]] = shin
    world[:, _J[f"{side}_ankle"]] = np.where(foot_visible, _limit_angle(shin, foot, 1.0), shin)
    world[:, _J[f"{side}_foot"]] = world[:, _J[f"{side}_ankle"]]


def _two_bones(
    parent: Array, first: Array, second: Array, along: Array, hinge: Array
) -> tuple[Array, Array]:
    """World rotations of two bones that lie `along` at rest and bend about `hinge`."""
    a = unit(_nonzero_or(first, parent @ along))
    b = unit(_nonzero_or(second, a))
    normal = np.cross(a, b)
    sine = np.linalg.norm(normal, axis=-1, keepdims=True)
    parent_hinge = _swing(parent, along, first) @ hinge
    confidence = np.clip((sine - _BENT_FROM) / (_FULLY_BENT - _BENT_FROM), 0.0, 1.0)
    # a hinge opens one way only: an observed axis opposite to the parent's is an error in depth
    confidence = confidence * (np.sum(normal * parent_hinge, axis=-1, keepdims=True) > -0.3 * sine)
    axis = confidence * normal / np.maximum(sine, 1e-9) + (1.0 - confidence) * parent_hinge
    rest = np.stack([along, hinge, np.cross(along, hinge)], axis=-1)
    upper = _orthonormal(a, axis) @ rest.T
    return upper, _swing(upper, along, second)


def _swing(parent: Array, rest: Array, observed: Array) -> Array:
    """`parent` after the least rotation that takes its `rest` direction to `observed`."""
    current = parent @ rest
    return rotation_between(current, _nonzero_or(observed, current)) @ parent


def _frame(x: Array, y: Array) -> Array:
    """Rotation whose x axis is along `x` and whose y axis is nearest to `y`."""
    right = unit(x)
    up = unit(y - np.sum(y * right, axis=-1, keepdims=True) * right)
    frame = np.stack([right, up, np.cross(right, up)], axis=-1)
    valid = np.abs(np.linalg.det(frame)) > 0.5  # false where landmarks coincide or are collinear
    return np.where(valid[..., None, None], frame, np.eye(3))


def _orthonormal(first: Array, second: Array) -> Array:
    a = unit(first)
    b = unit(second - np.sum(second * a, axis=-1, keepdims=True) * a)
    return np.stack([a, b, np.cross(a, b)], axis=-1)


def _limit_angle(parent: Array, child: Array, angle_rad: float) -> Array:
    """`child` brought to within `angle_rad` of `parent`."""
    rotation = matrix_to_axis_angle(np.swapaxes(parent, -1, -2) @ child)
    angle = np.linalg.norm(rotation, axis=-1, keepdims=True)
    scale = np.minimum(angle, angle_rad) / np.maximum(angle, 1e-9)
    return parent @ axis_angle_to_matrix(rotation * scale)


def _kabsch(rest: Array, observed: Array) -> Array:
    """Rotations [F 3 3] that best map `rest` [N 3] to `observed` [F N 3] (Kabsch 1976)."""
    a = rest - rest.mean(axis=0)
    b = observed - observed.mean(axis=1, keepdims=True)
    u, _, vt = np.linalg.svd(np.einsum("fni,nj->fij", b, a))
    flip = np.sign(np.linalg.det(u @ vt))[:, None, None]
    return np.concatenate([u[..., :2], u[..., 2:] * flip], axis=-1) @ vt


def _nonzero_or(direction: Array, other: Array) -> Array:
    """`direction`, or `other` where it is zero: two landmarks in one place."""
    zero = np.linalg.norm(direction, axis=-1, keepdims=True) < 1e-9
    return np.where(zero, other, direction)


def unit(vector: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """`vector` of length one; zero stays zero."""
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)
