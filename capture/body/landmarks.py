"""Where the estimator's 33 landmarks lie on the body model: rest points that move with a joint.

Most landmarks are a joint, or a vertex found by its place in the T-pose. The estimator was trained
on annotated photographs, so its "hip" is not the model's hip joint: an offset learnt from studio
performers is added, and the fit estimates the remainder for each person.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from capture.body.landmark_names import LANDMARK_COUNT, LANDMARK_NAMES
from capture.body.model import BodyModel, load_body_model
from scene.arrays import Array, Float, Int
from scene.body import Body
from scene.skeleton import JOINT_NAMES

_JOINT_OF = {
    "shoulder": "shoulder",
    "elbow": "elbow",
    "wrist": "wrist",
    "hip": "hip",
    "knee": "knee",
    "ankle": "ankle",
    "heel": "ankle",
    "foot_index": "foot",
    "pinky": "wrist",
    "index": "wrist",
    "thumb": "wrist",
}
_MOVES_WITH = {
    "left_shoulder": "left_collar",
    "right_shoulder": "right_collar",
    "left_hip": "pelvis",
    "right_hip": "pelvis",
}
"""A learnt offset of these must not rotate with the limb that begins there."""
_ON_A_JOINT = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_HAND_FROM_HAND_JOINT = {
    "index": (0.0, 0.0, 0.03),
    "pinky": (-0.01, 0.0, -0.035),
    "thumb": (-0.04, -0.01, 0.06),
}
"""m, for the left hand (palm down, fingers along +x)."""
_FACE_FROM_NOSE = {
    "left_eye_inner": (0.016, 0.036, -0.024),
    "left_eye": (0.031, 0.036, -0.028),
    "left_eye_outer": (0.045, 0.036, -0.034),
    "left_ear": (0.072, 0.012, -0.105),
    "mouth_left": (0.024, -0.036, -0.018),
}
"""m; the right side is the mirror image."""

OFFSETS_FILE = Path(__file__).parents[1] / "assets" / "landmark_offsets.json"

MIRROR: tuple[int, ...] = tuple(
    LANDMARK_NAMES.index(name.replace("left", "#").replace("right", "left").replace("#", "right"))
    for name in LANDMARK_NAMES
)
"""Index of each landmark's partner on the other side; the nose is its own."""


@dataclass(frozen=True, eq=False)
class BodyLandmarks:
    """Rest points of the 33 landmarks on a body model."""

    rest: Float[Array, "33 3"]
    """m, T-pose of the mean body."""
    directions: Float[Array, "33 3 B"]
    """m a unit of each shape number."""
    joints: Int[Array, "33"]
    """The joint that each landmark moves with."""


@cache
def load_body_landmarks() -> BodyLandmarks:
    """The landmarks on the body model that ships with the package."""
    return place_landmarks(load_body_model())


def place_landmarks(
    model: BodyModel, offsets: Mapping[str, Sequence[float]] | None = None
) -> BodyLandmarks:
    """Find each landmark's rest point on `model`: by anatomy, then by `offsets` (m, a landmark).

    Without `offsets`, those that `tools.build_landmarks` has learnt.
    """
    offsets = _learnt_offsets() if offsets is None else offsets
    rest = np.zeros((LANDMARK_COUNT, 3))
    directions = np.zeros((LANDMARK_COUNT, 3, model.shape_count))
    joints = np.zeros(LANDMARK_COUNT, dtype=np.int64)
    head = JOINT_NAMES.index("head")
    nose = _nose_vertex(model, head)
    for index, name in enumerate(LANDMARK_NAMES):
        side = -1.0 if "right" in name else 1.0
        part = name.replace("left_", "").replace("right_", "")
        if part in _JOINT_OF:
            joint = JOINT_NAMES.index(f"{'left' if side > 0 else 'right'}_{_JOINT_OF[part]}")
            point, moves = _limb_point(model, joint, part, side)
        else:
            left = name if name in _FACE_FROM_NOSE else LANDMARK_NAMES[MIRROR[index]]
            offset = np.array(_FACE_FROM_NOSE.get(left, (0.0, 0.0, 0.0)))
            joint, moves = head, model.vertex_directions[nose]
            point = model.rest_vertices[nose] * [0.0, 1.0, 1.0] + offset * [side, 1.0, 1.0]
        rest[index], directions[index] = point + offsets[name], moves
        joints[index] = JOINT_NAMES.index(_MOVES_WITH.get(name, JOINT_NAMES[joint]))
    return BodyLandmarks(rest, directions, joints)


def landmarks_on(body: Body) -> tuple[Float[Array, "33 3"], Array]:
    """Rest points of the landmarks on `body`, and the joint of each.

    A body does not hold its shape numbers: they are fitted to its joints.
    """
    model, landmarks = load_body_model(), load_body_landmarks()
    body_joints, mean = body.skeleton.rest_joints, model.rest_joints
    design = (model.joint_directions - model.joint_directions[0]).reshape(-1, model.shape_count)
    target = ((body_joints - body_joints[0]) - (mean - mean[0])).ravel()
    shape = np.linalg.lstsq(design, target, rcond=None)[0]
    joints = mean + model.joint_directions @ shape
    # residuals of the joints are added to their landmarks
    points = (
        landmarks.rest + landmarks.directions @ shape + (body_joints - joints)[landmarks.joints]
    )
    return points, landmarks.joints


@cache
def _learnt_offsets() -> dict[str, list[float]]:
    return json.loads(OFFSETS_FILE.read_text())


def _limb_point(model: BodyModel, joint: int, part: str, side: float) -> tuple[Array, Array]:
    if part in _ON_A_JOINT:
        return model.rest_joints[joint], model.joint_directions[joint]
    if part in _HAND_FROM_HAND_JOINT:
        hand = joint + 2  # SMPL lists left_wrist, right_wrist, left_hand, right_hand
        offset = np.array(_HAND_FROM_HAND_JOINT[part]) * [side, 1.0, 1.0]
        return model.rest_joints[hand] + offset, model.joint_directions[hand]
    own = np.flatnonzero(model.blend_weights[:, joint] > 0.5)
    z = model.rest_vertices[own, 2]
    vertex = own[np.argmin(z) if part == "heel" else np.argmax(z)]
    return model.rest_vertices[vertex], model.vertex_directions[vertex]


def _nose_vertex(model: BodyModel, head: int) -> int:
    own = np.flatnonzero(
        (model.blend_weights[:, head] > 0.5) & (np.abs(model.rest_vertices[:, 0]) < 0.01)
    )
    return int(own[np.argmax(model.rest_vertices[own, 2])])
