"""Makes `capture/assets/head_landmarks.npz`:
`python -m tools.build_head_landmarks FACE_MODEL MAKEHUMAN_ASSETS`.

A face landmarker's points are known on its own mean face, not on the body model's head. Here the
lifelike performers, whose heads' poses are exact, are filmed from the front, near and far, and
shown to it; where its points lie on the head, at rest, is their mean over performers and sides.
Small faces seem to look down by 7 degrees more than large ones.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from capture.detection.face_and_hands import FaceAndHandDetector, PartLandmarks
from capture.detection.rigid_parts import (
    HEAD_MIRROR,
    HEAD_POINTS,
    HEAD_POINTS_FILE,
    best_rotation,
)
from capture.storage import open_sequence
from capture.studio import make_sequence
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Pose
from scene.rotations import matrix_to_axis_angle
from scene.sequence import Sequence
from scene.skeleton import JOINT_NAMES

_HEAD = JOINT_NAMES.index("head")
_FRAMES, _SIZE_PX, _TURN_DEG = 12, 512, 40.0
_FRAMINGS = {"head": 256.0, "body": 60.0}
_MIRRORED = np.array([-1.0, 1.0, 1.0])


def main() -> None:
    """Film, look, average, write."""
    by_performer: dict[str, list[Array]] = {}
    with FaceAndHandDetector(Path(sys.argv[1]), None) as detector:
        for name in LIFELIKE_PERFORMERS:
            by_performer[name] = []
            for framing, half_px in _FRAMINGS.items():
                with tempfile.TemporaryDirectory() as folder:
                    out = Path(folder) / framing
                    make_sequence(
                        out,
                        performer=name,
                        assets=Path(sys.argv[2]),
                        frames=_FRAMES,
                        size=_SIZE_PX,
                        test_cameras=1,
                        turn_deg=_TURN_DEG,
                        framing=framing,
                    )
                    filmed = open_sequence(out)
                    by_performer[name] += points_on_head(filmed, detector, half_px)
    points = mean_points([np.mean(found, axis=0) for found in by_performer.values() if found])
    np.savez(HEAD_POINTS_FILE, points=points.astype(np.float32))
    for name, found in by_performer.items():
        errors = [np.degrees(rotation_error_rad(points, seen)) for seen in found]
        middle = 1e3 * np.linalg.norm(np.mean(found, axis=(0, 1)) - points.mean(axis=0))
        print(
            f"{name}: found in {len(found)} of {len(_FRAMINGS) * _FRAMES} frames; rotation off by "
            f"{np.round(np.mean(errors, axis=0), 1)} degrees in the mean; middle {middle:.0f} mm"
        )


def points_on_head(
    filmed: Sequence, detector: FaceAndHandDetector, half_px: float
) -> list[Float[Array, "P 3"]]:
    """The rigid points of the face in each frame in which it is found, m from the head's joint, in
    its own axes; their depth, which a picture does not show, is as far from the joint as that of
    the performer's own face. `half_px` is half the side of the square about the head."""
    found, front = [], _face_front(filmed)
    for camera, pose, face in found_faces(filmed, detector, half_px):
        head = _head(filmed, pose)
        pixels, depth = camera.project(head[:3, 3])
        chosen, m_per_px = list(HEAD_POINTS), float(depth) / camera.focal_px
        shape = face.in_camera(camera.focal_px, camera.intrinsics[:2, 2])[chosen]
        shape += np.append((face.pixels[chosen] - pixels - shape[:, :2]).mean(axis=0), 0.0)
        to_head = camera.rotation @ head[:3, :3]
        points = m_per_px * shape @ to_head
        # a picture does not show how far along the line of sight they are
        points += (front - points[:, 2].max()) / to_head[2, 2] * to_head[2]
        found.append(points)
    return found


def found_faces(
    filmed: Sequence, detector: FaceAndHandDetector, half_px: float
) -> Iterator[tuple[Camera, Pose, PartLandmarks]]:
    """Camera, pose and landmarks of each training frame in which the face is found, over grey, in a
    square about the head whose half side is `half_px`."""
    source = filmed.train
    for index in range(len(source)):
        camera, pose = source.camera(index), source.pose(index)
        grey = 0.5 * (1.0 - source.mask(index)[..., None])
        picture = np.rint(255.0 * np.clip(source.image(index) + grey, 0.0, 1.0)).astype(np.uint8)
        middle, _ = camera.project(_head(filmed, pose)[:3, 3])
        face = detector.face_about(picture, middle, half_px)
        if face is not None:
            yield camera, pose, face


def _head(filmed: Sequence, pose: Pose) -> Float[Array, "4 4"]:
    skeleton = filmed.body.skeleton
    return skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[_HEAD]


def _face_front(filmed: Sequence) -> float:
    """How far the forehead lies before the head's joint, m."""
    body = filmed.body
    assert body.rest_vertices is not None
    assert body.blend_weights is not None
    head = body.rest_vertices[body.blend_weights[:, _HEAD] > 0.5] - body.skeleton.rest_joints[_HEAD]
    forehead = head[(np.abs(head[:, 0]) < 0.02) & (head[:, 1] > 0.5 * head[:, 1].max())]
    return float(forehead[:, 2].max())


def mean_points(means: list[Float[Array, "P 3"]]) -> Float[Array, "P 3"]:
    """The mean over performers and sides."""
    mean = np.mean(means, axis=0)
    return 0.5 * (mean + mean[list(HEAD_MIRROR)] * _MIRRORED)


def rotation_error_rad(points: Float[Array, "P 3"], seen: Float[Array, "P 3"]) -> Float[Array, "3"]:
    """How far the rotation that `seen` implies is from none."""
    return matrix_to_axis_angle(best_rotation(points, seen))


if __name__ == "__main__":
    main()
