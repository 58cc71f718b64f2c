"""Masks of a whole clip: what single frames miss, a still camera and their neighbours know."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from capture.detection.landmarks import Landmarks
from capture.segmentation.clip import segment_clip
from scene.arrays import Array
from tests.capture.people import body, camera, picture, seen_by, standing

FRAMES, LOST = 6, 3


@pytest.fixture(scope="module")
def truth() -> list[Landmarks]:
    motion = standing(FRAMES, turn_rad=0.4)
    return [seen_by(camera(), body(), motion.pose(frame)) for frame in range(FRAMES)]


def overlap(a: Array, b: Array) -> float:
    return float(((a > 0.5) & (b > 0.5)).sum() / ((a > 0.5) | (b > 0.5)).sum())


def test_each_frame_has_the_mask_of_its_own_person_and_lost_ones_have_none(truth):
    people = [None if frame == LOST else person for frame, person in enumerate(truth)]
    shares: list[float] = []
    masks = segment_clip([picture(person) for person in truth], people, shares.append)
    assert [mask is None for mask in masks] == [frame == LOST for frame in range(FRAMES)]
    for mask, person in zip(masks, truth, strict=True):
        if mask is not None:
            assert overlap(mask, person.mask) > 0.97
            assert mask.dtype == np.float32
            assert 0.0 <= mask.min() <= mask.max() <= 1.0
    assert shares == pytest.approx(np.arange(1, FRAMES + 1) / FRAMES)


def test_a_still_background_gives_back_what_the_estimator_left_out(truth):
    """A forearm that coarse masks lack, before a wall that other frames show."""
    rng = np.random.default_rng(0)
    wall = cv2.resize(rng.integers(90, 150, (16, 16, 3)).astype(np.uint8), (256, 256))
    images, blind = [], []
    for index, person in enumerate(truth * 2):
        shift = 20 * (index % 6) - 50
        moved = replace(
            person,
            pixels=person.pixels + np.array([shift, 0.0]),
            mask=np.roll(person.mask, shift, axis=1),
        )
        image = wall.copy()
        image[moved.mask > 0.5] = (200, 60, 40)
        elbow, wrist = moved.pixels[13], moved.pixels[15]
        cut = moved.mask.copy()
        middle = 0.4 * elbow + 0.6 * wrist
        cv2.line(cut, middle.astype(int).tolist(), wrist.astype(int).tolist(), 0.0, 9)
        images.append(image)
        blind.append((moved, replace(moved, mask=cut)))
    masks = segment_clip(images, [person for _, person in blind])
    gained = []
    for mask, (whole, given) in zip(masks, blind, strict=True):
        missing = (whole.mask > 0.5) & (given.mask < 0.5)
        assert mask is not None
        gained.append(mask[missing].mean())
    assert np.mean(gained) > 0.8


def test_the_edge_of_who_stands_still_does_not_flicker(truth):
    """Each frame's own noise moves the edge; where the picture stayed the same, frames agree."""
    rng = np.random.default_rng(0)
    person = truth[0]
    images, people = [], []
    for _ in range(4):
        images.append(picture(person))
        wide = cv2.dilate(person.mask, np.ones((3, 3))) if rng.random() < 0.5 else person.mask
        people.append(replace(person, mask=wide))
    masks = segment_clip(images, people)
    assert all(mask is not None for mask in masks)
    assert np.ptp(np.stack([mask for mask in masks if mask is not None]), axis=0).max() < 0.5


def test_a_clip_in_which_nobody_was_found_has_no_masks():
    images = [np.zeros((32, 32, 3), np.uint8)] * 2
    assert segment_clip(images, [None, None]) == [None, None]
