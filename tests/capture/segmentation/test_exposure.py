"""Gains a channel and frame, known and found again."""

from __future__ import annotations

import numpy as np
import pytest

from capture.detection.landmarks import Landmarks
from capture.segmentation.exposure import evened, find_gains
from capture.sources.video import evenly_spaced, read_video
from scene.arrays import Array
from tests.shared_data import shared_data

FRAMES = 24
HEIGHT, WIDTH = 144, 192


def room(seed: int = 0) -> Array:
    """Patches of colour, none of them near black or white."""
    patches = np.random.default_rng(seed).uniform(40, 150, (9, 12, 3))
    return np.kron(patches, np.ones((16, 16, 1)))


def gains(frames: int = FRAMES) -> Array:
    """Of half a stop and a tint, about 1 in the median."""
    phase = np.linspace(0.0, 2.0 * np.pi, frames)[:, None]
    return np.exp(0.15 * np.sin(phase) + 0.05 * np.sin(2.0 * phase + np.arange(3)))


def filmed(scenes: list[Array], factors: Array) -> list[Array]:
    return [
        np.clip(np.rint(scene * factor), 0, 255).astype(np.uint8)
        for scene, factor in zip(scenes, factors, strict=True)
    ]


def relative(found: Array) -> Array:
    """Gains without what is the same in all frames."""
    return np.log(found) - np.log(found).mean(axis=0)


def somebody(left: int, right: int, height: int = HEIGHT, width: int = WIDTH) -> Landmarks:
    """Who covers the columns from `left` to `right`."""
    mask = np.zeros((height, width), np.float32)
    mask[:, left:right] = 1.0
    corners = np.array([[left, 0.0], [right, height]])
    pixels = np.tile(corners, (17, 1))[:33]
    return Landmarks(pixels, np.zeros((33, 3)), np.zeros(33), mask)


def walked_through() -> tuple[list[Array], list[Landmarks | None]]:
    """A room, through which a person of another colour walks, and who comes close in the end."""
    scenes, people = [room() for _ in range(FRAMES)], []
    for number, scene in enumerate(scenes):
        left, wide = (6 * number, 48) if number < FRAMES - 6 else (30, 130)
        scene[:, left : left + wide] = (60.0, 110.0, 45.0)
        people.append(somebody(left, left + wide))
    return scenes, people


def test_gains_are_found_whoever_walks_through_and_comes_close():
    scenes, people = walked_through()
    found = find_gains(filmed(scenes, gains()), people)
    np.testing.assert_allclose(relative(found), relative(gains()), atol=0.01)


def test_evened_pictures_are_those_of_a_steady_camera():
    scenes, people = walked_through()
    images = filmed(scenes, gains())
    even = np.stack(evened(images, find_gains(images, people))).astype(float)
    steady = np.stack(scenes)
    level = np.median(even / steady, axis=(0, 1, 2))
    assert np.abs(even - steady * level).mean() < 1.0
    assert np.abs(np.stack(images) - steady).mean() > 5.0


def test_a_steady_camera_s_pictures_are_left_as_they_are():
    scenes, people = walked_through()
    images = filmed(scenes, np.ones((FRAMES, 3)))
    found = find_gains(images, people)
    assert (found == 1.0).all()
    assert all(after is before for after, before in zip(evened(images, found), images, strict=True))


def test_a_camera_that_moves_tells_nothing_about_its_exposure():
    images = filmed([room(seed) for seed in range(FRAMES)], gains())
    assert (find_gains(images, [somebody(0, 20)] * FRAMES) == 1.0).all()


@pytest.mark.parametrize("why", ["it shows another room", "the person is lost", "all is covered"])
def test_a_frame_that_tells_nothing_has_its_neighbours_gains(why: str):
    scenes = [room() for _ in range(FRAMES)]
    people: list[Landmarks | None] = [somebody(60, 100)] * FRAMES
    if why == "it shows another room":
        scenes[10] = room(1)
    else:
        scenes[10] = np.full_like(room(), 200.0)
        people[10] = None if why == "the person is lost" else somebody(0, WIDTH)
    found = find_gains(filmed(scenes, gains()), people)
    np.testing.assert_allclose(found[10], (found[9] + found[11]) / 2.0, rtol=0.005)


@pytest.mark.parametrize("level", [0, 255])
def test_pictures_without_a_shade_tell_nothing(level):
    images = [np.full((HEIGHT, WIDTH, 3), level, np.uint8) for _ in range(FRAMES)]
    assert (find_gains(images, [somebody(60, 100)] * FRAMES) == 1.0).all()


@pytest.mark.parametrize("name", ["grey_shirt_bird.mkv", "orange_hoodie_learn.mkv"])
def test_gains_of_real_footage_are_found_again(name):
    clip = read_video(shared_data(f"real-webcam-people/{name}"))
    some = [clip.images[i] for i in evenly_spaced(len(clip.images), FRAMES)]
    people = [somebody(150, 490, *some[0].shape[:2])] * len(some)
    assert (find_gains(some, people) == 1.0).all()
    known = gains(len(some))
    found = find_gains(filmed([image.astype(float) for image in some], known), people)
    np.testing.assert_allclose(relative(found), relative(known), atol=0.01)
