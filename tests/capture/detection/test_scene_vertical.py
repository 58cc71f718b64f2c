"""The vertical of rooms whose camera is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from capture.detection.scene_vertical import scene_vertical
from scene.arrays import Array

WIDTH, HEIGHT, FOCAL_PX = 640, 480, 520.0
RNG_SEED = 4
POSTS_M = [(x, z) for x in (-1.6, -1.1, 0.9, 1.5) for z in (-2.6, -3.4)]


def up_of(pitch_deg: float, roll_deg: float) -> Array:
    """The vertical in the frame of a camera that looks up by `pitch_deg`."""
    pitch, roll = np.deg2rad([pitch_deg, roll_deg])
    tilted = np.array([0.0, np.cos(pitch), -np.sin(pitch)])
    turn = np.array(
        [[np.cos(roll), -np.sin(roll), 0.0], [np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]]
    )
    return turn @ tilted


def room(up: Array, *, posts: bool = True, slanted: int = 0) -> Array:
    """Posts that stand in a room, level boards, and `slanted` lines in any direction."""
    picture = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)
    level = np.cross(np.array([0.0, 0.0, 1.0]), up)
    side = -level / np.linalg.norm(level)
    away = np.cross(side, up)
    rng = np.random.default_rng(RNG_SEED)
    segments = []
    for x, z in POSTS_M if posts else []:
        foot = x * side + z * away
        segments += [(foot - 2.0 * up, foot + 2.0 * up)]
    for height in (-0.5, 0.2, 0.9):
        middle = height * up - 3.0 * away
        segments += [(middle - 2.0 * side, middle + 2.0 * side)]
    for start, end in segments:
        line(picture, [FOCAL_PX * (p[:2] * [1.0, -1.0]) / -p[2] for p in (start, end)])
    for _ in range(slanted):
        middle, turn = rng.uniform(-200.0, 200.0, 2), rng.uniform(0.0, np.pi)
        reach = 40.0 * np.array([np.cos(turn), np.sin(turn)])
        line(picture, [middle - reach, middle + reach])
    return picture


def line(picture: Array, ends: list[Array]) -> None:
    """Draws one between two places, px from the picture's middle."""
    middle = np.array([0.5 * WIDTH, 0.5 * HEIGHT])
    first, second = (np.rint(end + middle).astype(int).tolist() for end in ends)
    cv2.line(picture, first, second, (60, 60, 60), 5, cv2.LINE_AA)


def angle_deg(a: Array, b: Array) -> float:
    return float(np.rad2deg(np.arccos(np.clip(a @ b, -1.0, 1.0))))


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (14.0, 1.0), (-20.0, -3.0), (8.0, 5.0)])
def test_a_pitched_cameras_vertical_is_found_among_other_lines(pitch, roll):
    up = up_of(pitch, roll)
    found = scene_vertical([room(up, slanted=6)] * 3, [None] * 3, FOCAL_PX)
    assert found is not None
    assert angle_deg(found, up) < 1.0


@pytest.mark.parametrize("slanted", [0, 12])
def test_a_room_without_vertical_lines_tells_nothing(slanted):
    picture = room(up_of(10.0, 0.0), posts=False, slanted=slanted)
    assert scene_vertical([picture], [None], FOCAL_PX) is None


def test_lines_of_the_person_do_not_count():
    picture = room(up_of(10.0, 0.0))
    everywhere = np.ones((HEIGHT, WIDTH), np.float32)
    assert scene_vertical([picture], [everywhere], FOCAL_PX) is None


def test_a_camera_that_is_tilted_within_the_clip_has_no_one_vertical():
    pictures = [room(up_of(pitch, 0.0)) for pitch in (-16.0, -8.0, 0.0, 8.0, 16.0)]
    assert scene_vertical(pictures, [None] * 5, FOCAL_PX) is None
