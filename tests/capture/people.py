"""Landmarks of known people: what a perfect estimator would say of a posed body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from capture.body.inverse_kinematics import OPENCV_TO_OPENGL
from capture.body.landmark_names import LANDMARK_NAMES
from capture.body.landmarks import load_body_landmarks
from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks
from capture.overlay import project_surface
from scene.arrays import Array
from scene.body import Body
from scene.camera import Camera, orbit_camera
from scene.limits import ELBOW_HINGE
from scene.motion import Motion, Pose
from scene.skeleton import JOINT_NAMES

JOINT = {name: index for index, name in enumerate(JOINT_NAMES)}
LANDMARK = {name: index for index, name in enumerate(LANDMARK_NAMES)}


def body() -> Body:
    """The mean body."""
    model = load_body_model()
    return model.body(np.zeros(model.shape_count))


def standing(frames: int, *, turn_rad: float = 0.0, frames_per_second: float = 30.0) -> Motion:
    """Arms half down, elbows swinging, turned by `turn_rad` over the clip."""
    angles = np.zeros((frames, 24, 3))
    share = np.linspace(0.0, 1.0, frames)
    angles[:, 0, 1] = turn_rad * share
    swing = np.sin(2.0 * np.pi * share)
    for side, out in (("left", 1.0), ("right", -1.0)):
        angles[:, JOINT[f"{side}_shoulder"], 2] = -out * (0.9 + 0.2 * swing)
        bend = (0.6 + 0.4 * swing)[:, None]
        angles[:, JOINT[f"{side}_elbow"]] = bend * np.array(ELBOW_HINGE[side])
        angles[:, JOINT[f"{side}_hip"], 0] = -0.1
        angles[:, JOINT[f"{side}_knee"], 0] = 0.2
    times = np.arange(frames) / frames_per_second
    return Motion(times, angles, np.zeros((frames, 3)), np.ones((frames, 24)))


def camera(size: int = 256) -> Camera:
    """In front of the person, 60 degrees of view, the whole body in the picture."""
    return orbit_camera((0.0, 0.9, 0.0), 2.2, 0.0, 0.05, size, size, np.pi / 3.0)


def landmark_positions(person: Body, pose: Pose) -> Array:
    """World places [33 3] of the landmarks of `person` (of mean shape) in `pose`."""
    marks = load_body_landmarks()
    moved = person.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    own = moved[marks.joints]
    return np.einsum("nij,nj->ni", own[:, :3, :3], marks.rest) + own[:, :3, 3]


def seen_by(view: Camera, person: Body, pose: Pose) -> Landmarks:
    """What a perfect estimator says."""
    points = landmark_positions(person, pose)
    pixels, _ = view.project(points)
    hips = 0.5 * (points[LANDMARK["left_hip"]] + points[LANDMARK["right_hip"]])
    mask = project_surface(view, person, pose)
    return Landmarks(
        pixels,
        (points - hips) @ view.rotation.T,
        np.ones(len(LANDMARK_NAMES)),
        mask.astype(np.float32),
    )


def picture(person: Landmarks, colour: tuple[int, int, int] = (200, 60, 40)) -> Array:
    """RGB of a flat person on a grey wall."""
    image = np.full((*person.mask.shape, 3), 120, dtype=np.uint8)
    image[person.mask > 0.5] = colour
    return image


@dataclass
class FakeEstimator:
    """A `PoseEstimator` that finds blobs of given colours and knows their landmarks.

    `people` holds the truth of each colour; a blob is reported where enough of it is in the window.
    """

    people: dict[tuple[int, int, int], Sequence[Landmarks]]
    frame: int = 0
    sizes: list[tuple[int, int]] = field(default_factory=list)

    def detect(self, image: Array) -> list[Landmarks]:
        """People whose colour is in the picture, with landmarks from their bounding boxes."""
        self.sizes.append((image.shape[1], image.shape[0]))
        found = []
        for colour, truth in self.people.items():
            mask = (image == np.array(colour, dtype=np.uint8)).all(axis=2)
            rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            if len(rows) < 20:
                continue
            best = min(truth, key=lambda t: abs(np.ptp(np.nonzero(t.mask)[1]) - np.ptp(columns)))
            corner = np.array([np.nonzero(best.mask)[1].min(), np.nonzero(best.mask)[0].min()])
            pixels = best.pixels - corner + [columns[0], rows[0]]
            found.append(Landmarks(pixels, best.world, best.visibility, mask.astype(np.float32)))
        return found


def up_is_down(points: Array) -> Array:
    """World (y up) to MediaPipe's world axes; its own inverse."""
    return points * OPENCV_TO_OPENGL


def write_clip(path, images: Sequence[Array], frames_per_second: int = 30) -> None:
    """An MP4 of RGB `images`."""
    from capture.overlay import write_video

    write_video(images, path, frames_per_second)


def encoded(image: Array, suffix: str = ".png") -> bytes:
    """`image` (RGB) as a picture file."""
    return cv2.imencode(suffix, np.ascontiguousarray(image[..., ::-1]))[1].tobytes()
