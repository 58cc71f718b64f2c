"""Head and palms as rigid parts: where their landmarks lie on the body, and how they are turned."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from capture.detection.face_and_hands import ClipParts, PartLandmarks
from scene.arrays import Array, Bool, Float
from scene.camera import Camera
from scene.skeleton import JOINT_NAMES

PARTS = ("head", "left_wrist", "right_wrist")
"""The joints that the parts move with."""
PART_JOINTS = tuple(JOINT_NAMES.index(name) for name in PARTS)

HEAD_POINTS = (
    *(10, 151, 9, 8, 168, 6, 197, 33, 263, 133, 362, 127, 356, 234, 454, 93, 323, 54, 284),
    *(103, 332, 67, 297, 109, 338, 21, 251, 162, 389, 116, 345, 117, 346),
)
"""Landmarks of a face that its expressions hardly move: forehead, temples, corners of the eyes,
bridge of the nose, cheekbones."""
HEAD_MIRROR = (
    *(0, 1, 2, 3, 4, 5, 6, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15, 18, 17),
    *(20, 19, 22, 21, 24, 23, 26, 25, 28, 27, 30, 29, 32, 31),
)
"""Places in `HEAD_POINTS` of their partners on the other side."""
HEAD_POINTS_FILE = Path(__file__).parents[1] / "assets" / "head_landmarks.npz"
PALM_POINTS = (0, 5, 9, 13, 17)
"""Landmarks of a hand: wrist and knuckles."""
_LEFT_PALM_M = np.array(
    [
        [0.0, 0.0, 0.0],
        [0.1073, 0.0100, 0.0349],
        [0.1084, 0.0051, 0.0074],
        [0.1040, -0.0017, -0.0125],
        [0.0956, -0.0134, -0.0298],
    ]
)
"""From the wrist's joint at rest to the bones of anny's fingers."""
_LEAST_PALM_PX = 25.0
"""From wrist to knuckles: smaller hands, seen from their edge, are taken for flat ones."""
_MIRRORED = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class RigidParts:
    """Head, left and right palm in F frames, axes of OpenGL's camera."""

    middles_px: Float[Array, "F 3 2"]
    """Mean of each part's landmarks in the picture."""
    palms_px: Float[Array, "F 2 5 2"]
    """`PALM_POINTS` of the left and the right hand."""
    rotations: Float[Array, "F 3 3 3"]
    """From rest to the camera."""
    found: Bool[Array, "F 3"]
    turned: Bool[Array, "F 3"]
    """Where the rotation can be believed, too."""
    palms_found: Bool[Array, "F 2"]
    """Hands of the side that the network takes them for: of others, knuckles may be mirrored."""


@cache
def rest_points(part: str) -> Float[Array, "P 3"]:
    """The landmarks of `part` (of `PARTS`) at rest, m from its joint, on the mean body."""
    if part == "head":
        with np.load(HEAD_POINTS_FILE) as stored:
            return stored["points"].astype(np.float64)
    return _LEFT_PALM_M if part == "left_wrist" else _LEFT_PALM_M * _MIRRORED


def rigid_parts(parts: ClipParts, focal_px: float, centre: Float[Array, "2"]) -> RigidParts:
    """Where the parts are, and how they are turned, in a camera with principal point `centre`."""
    frames = len(parts.faces)
    found = np.zeros((frames, len(PARTS)), bool)
    turned, middles = found.copy(), np.zeros((frames, len(PARTS), 2))
    palms = np.zeros((frames, len(PARTS) - 1, len(PALM_POINTS), 2))
    palms_found = np.zeros((frames, len(PARTS) - 1), bool)
    rotations = np.tile(np.eye(3), (frames, len(PARTS), 1, 1))
    for frame in range(frames):
        hands = [side[frame] for side in parts.hands]
        seen = (parts.faces[frame], *(None if hand is None else hand.landmarks for hand in hands))
        agreed = (True, *(hand is not None and hand.side_agreed for hand in hands))
        for part, landmarks in enumerate(seen):
            if landmarks is None:
                continue
            chosen = list(HEAD_POINTS if part == 0 else PALM_POINTS)
            found[frame, part] = True
            turned[frame, part] = part == 0 or (
                agreed[part] and _palm_px(landmarks) >= _LEAST_PALM_PX
            )
            middles[frame, part] = landmarks.pixels[chosen].mean(axis=0)
            if part > 0:
                palms[frame, part - 1] = landmarks.pixels[chosen]
                palms_found[frame, part - 1] = agreed[part]
            rotations[frame, part] = _rotation(landmarks, chosen, PARTS[part], focal_px, centre)
    return RigidParts(middles, palms, rotations, found, turned, palms_found)


def _palm_px(hand: PartLandmarks) -> float:
    wrist, middle_knuckle = hand.pixels[[0, 9]]
    return float(np.linalg.norm(middle_knuckle - wrist))


def _rotation(
    landmarks: PartLandmarks,
    chosen: list[int],
    part: str,
    focal_px: float,
    centre: Float[Array, "2"],
) -> Float[Array, "3 3"]:
    seen = landmarks.in_camera(focal_px, centre)[chosen] * OPENCV_TO_OPENGL
    return best_rotation(rest_points(part), seen)


def head_rotation(face: PartLandmarks, camera: Camera) -> Float[Array, "3 3"]:
    """How the head of a `face` in the picture of `camera` is turned, from rest to the camera, in
    OpenGL's axes."""
    k = camera.intrinsics
    return _rotation(face, list(HEAD_POINTS), "head", camera.focal_px, k[:2, 2])


def best_rotation(rest: Float[Array, "P 3"], seen: Float[Array, "P 3"]) -> Float[Array, "3 3"]:
    """The rotation of `rest` about its middle that lies nearest to `seen`, whatever the scale of
    either (Kabsch 1976)."""
    a, b = rest - rest.mean(axis=0), seen - seen.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    flip = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return (u * flip) @ vt
