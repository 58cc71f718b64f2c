"""A tiny performer for the field's tests: 48 px frames of a striped body, painted face by face."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from capture.body.model import load_body_model
from renderer.field.settings import FieldSettings
from renderer.field.sizes import FieldSizes, GridSize, MlpSize
from scene import (
    JOINT_NAMES,
    NOVEL_VIEW,
    UNSEEN_POSE,
    Body,
    Camera,
    Frame,
    Motion,
    Pose,
    PoseTrust,
    Sequence,
    orbit_camera,
)

SIZE = 48
TINY = FieldSettings(
    sizes=FieldSizes(
        colour=MlpSize(depth=1, width=8),
        grid=GridSize(voxel_m=0.04, channels=4, inside_m=0.06, outside_m=0.04),
        volume=(16, 40, 40),
        refiner=MlpSize(depth=1, width=16),
        posed_grid=32,
        inverse_rounds=2,
        step_m=0.02,
    ),
    table_rate=0.1,
    field_rate=1e-2,
    motion_rate=1e-3,
    frames_a_step=2,
    rays_a_frame=200,
)


class Frames:
    """Frames held in memory (a FrameSource)."""

    def __init__(self, frames: list[Frame]) -> None:
        self._frames = frames

    def __len__(self) -> int:
        return len(self._frames)

    def camera(self, index: int) -> Camera:
        return self._frames[index].camera

    def pose(self, index: int) -> Pose:
        return self._frames[index].pose

    def image(self, index: int) -> np.ndarray:
        return self._frames[index].image

    def mask(self, index: int) -> np.ndarray:
        return self._frames[index].mask


@cache
def body() -> Body:
    """A body of mean shape."""
    model = load_body_model()
    return model.body(np.zeros(model.shape_count))


def pose(turn_rad: float, bend_rad: float = 0.0, time_s: float = 0.0) -> Pose:
    """Arms lowered, turned about the vertical, elbows bent."""
    angles = np.zeros((24, 3))
    angles[0, 1] = turn_rad
    angles[JOINT_NAMES.index("left_shoulder"), 2] = -1.0
    angles[JOINT_NAMES.index("right_shoulder"), 2] = 1.0
    angles[JOINT_NAMES.index("left_elbow"), 1] = -bend_rad
    return Pose(angles, np.zeros(3), time_s)


def view(azimuth_rad: float = 0.0, size: int = SIZE) -> Camera:
    """A camera that sees the whole body."""
    return orbit_camera((0.0, 0.9, 0.0), 4.0, azimuth_rad, 0.05, size, size)


def paint(person: Body, camera: Camera, moment: Pose) -> Frame:
    """Every face as one point, the nearest wins; colours change with rest height and side."""
    assert person.rest_vertices is not None
    assert person.faces is not None
    posed = person.posed_vertices(moment)[person.faces].mean(axis=1)
    rest = person.rest_vertices[person.faces].mean(axis=1)
    stripes = np.floor(rest[:, 1] / 0.3) % 2
    colours = np.stack([0.2 + 0.6 * stripes, 0.5 + 0.4 * np.sign(rest[:, 2]), 0.7 - 0.3 * stripes])
    pixels, depth = camera.project(posed)
    column, row = np.floor(pixels).astype(int).T
    order = np.argsort(-depth)
    image = np.zeros((camera.height, camera.width, 3), np.float32)
    mask = np.zeros((camera.height, camera.width), np.float32)
    image[row[order], column[order]] = np.clip(colours.T[order], 0.0, 1.0)
    mask[row[order], column[order]] = 1.0
    return Frame(image, mask, camera, moment)


@cache
def sequence(frames: int = 8) -> Sequence:
    """A full turn before one camera, with two views and one pose that training does not see."""
    poses = [pose(2.0 * np.pi * i / frames, 0.1 * i, 0.1 * i) for i in range(frames)]
    shots = [paint(body(), view(), moment) for moment in poses]
    novel = [paint(body(), view(azimuth), poses[1]) for azimuth in (0.4, 2.5)]
    unseen = [paint(body(), view(1.2), pose(0.3, 1.0))]
    return Sequence(
        person="tiny",
        frames_per_second=10.0,
        body=body(),
        train=Frames(shots),
        data_hash="0" * 64,
        motion=Motion.from_poses(poses),
        test={NOVEL_VIEW: Frames(novel), UNSEEN_POSE: Frames(unseen)},
        pose_trust=PoseTrust.EXACT,
    )


def without_surface(given: Sequence) -> Sequence:
    """The same clip of a person of whom joints alone are known."""
    return replace(given, body=Body(given.body.skeleton))
