"""Masks: edges follow the picture, other people and furniture stay out."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from capture.detection.landmarks import Landmarks
from capture.segmentation.background import learn_background
from capture.segmentation.masks import (
    bone_points,
    dilated_person_mask,
    draw_bones,
    keep_connected,
    mask_bounds,
    refine_mask,
    smooth_masks,
)
from tests.capture.people import body, camera, picture, seen_by, standing


@pytest.fixture(scope="module")
def person() -> Landmarks:
    return seen_by(camera(), body(), standing(4).pose(1))


def _overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float(((a > 0.5) & (b > 0.5)).sum() / ((a > 0.5) | (b > 0.5)).sum())


def test_a_coarse_mask_finds_the_pictures_edges(person):
    image = picture(person)
    small = cv2.resize(person.mask, (48, 48), interpolation=cv2.INTER_AREA)
    coarse = cv2.resize(small, (256, 256), interpolation=cv2.INTER_LINEAR)
    refined = refine_mask(image, replace(person, mask=coarse))
    assert _overlap(coarse, person.mask) < 0.95
    assert _overlap(refined, person.mask) > 0.97
    assert refined.dtype == np.float32
    assert 0.0 <= refined.min() <= refined.max() <= 1.0


def test_the_inside_is_solid_and_the_outside_empty(person):
    refined = refine_mask(picture(person), person)
    deep = cv2.erode(person.mask, np.ones((9, 9))) > 0.5
    far = cv2.dilate(person.mask, np.ones((25, 25))) < 0.5
    assert refined[deep].min() > 0.99
    assert refined[far].max() < 0.01


def test_what_no_bone_touches_is_dropped(person):
    chair = person.mask.copy()
    chair[10:60, 220:250] = 1.0
    kept = keep_connected(chair, person)
    assert kept[10:60, 220:250].max() == 0.0
    assert kept[person.mask > 0.5].min() == 1.0
    assert refine_mask(picture(person), replace(person, mask=chair))[10:60, 220:250].max() == 0.0


def test_a_hand_cut_off_by_a_table_stays(person):
    cut = person.mask.copy()
    wrist = person.pixels[15].astype(int)
    elbow = person.pixels[13].astype(int)
    row = (wrist[1] + elbow[1]) // 2
    cut[row - 1 : row + 1] = 0.0
    kept = keep_connected(cut, person)
    assert kept[wrist[1] - 2, wrist[0]] == 1.0


def test_an_empty_mask_stays_empty(person):
    empty = replace(person, mask=np.zeros_like(person.mask))
    assert refine_mask(picture(person), empty).max() == 0.0


def test_hidden_bones_do_not_vouch(person):
    hidden = replace(person, visibility=np.zeros(33))
    assert len(bone_points(hidden)) == 1
    assert len(bone_points(person)) > 100


def test_an_edge_pixel_gets_the_share_of_its_colour(person):
    """The person's outline, blurred as by a lens: its alpha is found again."""
    sharp = person.mask.astype(np.float32)
    alpha = cv2.GaussianBlur(sharp, (0, 0), 1.0)
    own, wall = np.array([200.0, 60.0, 40.0]), np.array([120.0, 120.0, 120.0])
    image = np.round(alpha[..., None] * own + (1.0 - alpha[..., None]) * wall).astype(np.uint8)
    found = refine_mask(image, person)
    edge = (alpha > 0.05) & (alpha < 0.95)
    assert np.abs(found - alpha)[edge].mean() < 0.7 * np.abs(sharp - alpha)[edge].mean()


def test_a_still_camera_gives_back_a_hand_that_was_left_out():
    motion = standing(24, turn_rad=2.0)
    people = [seen_by(camera(), body(), motion.pose(i)) for i in range(24)]
    images = [picture(one) for one in people]
    background = learn_background(images, [dilated_person_mask(one) for one in people])
    person, image = people[0], images[0]
    x, y = person.pixels[19].astype(int)  # the left index finger
    around = (slice(y - 8, y + 8), slice(x - 8, x + 8))
    cut = person.mask.copy()
    cut[around] = 0.0
    short = replace(person, mask=cut)
    hand = person.mask[around] > 0.5
    assert refine_mask(image, short)[around][hand].mean() < 0.5
    assert refine_mask(image, short, background)[around][hand].mean() > 0.9


def test_what_stands_still_does_not_flicker(person):
    rng = np.random.default_rng(0)
    image = picture(person)
    edge = cv2.dilate(person.mask, np.ones((5, 5))) - cv2.erode(person.mask, np.ones((5, 5))) > 0
    masks = [
        np.where(edge, rng.random(edge.shape), person.mask).astype(np.float32) for _ in range(3)
    ]
    steady = [np.asarray(mask) for mask in smooth_masks([image] * 3, masks)]
    assert (
        np.abs(steady[1] - steady[0])[edge].mean() < 0.6 * np.abs(masks[1] - masks[0])[edge].mean()
    )
    assert (steady[1] == person.mask)[~edge].all()


def test_what_moves_keeps_its_own_edge():
    motion = standing(3, turn_rad=1.0)
    people = [seen_by(camera(), body(), motion.pose(i)) for i in range(3)]
    steady = smooth_masks([picture(one) for one in people], [one.mask for one in people])
    for one, mask in zip(people, steady, strict=True):
        assert mask is not None
        assert np.abs(mask - one.mask).max() < 0.1


def test_a_lost_frame_stays_lost(person):
    steady = smooth_masks([picture(person)] * 3, [person.mask, None, person.mask])
    assert steady[1] is None
    np.testing.assert_array_equal(steady[0], person.mask)


def test_bones_reach_the_toes(person):
    drawn = draw_bones(person, person.mask.shape, 3)
    x, y = person.pixels[31].astype(int)  # the left foot
    assert drawn[y - 1 : y + 2, x - 1 : x + 2].any()
    assert not draw_bones(replace(person, visibility=np.zeros(33)), (64, 64), 3).any()


def test_a_window_holds_the_person_of_all_frames_and_a_margin_inside_the_picture():
    masks = [np.zeros((60, 80), np.float32), None, np.zeros((60, 80), np.float32)]
    masks[0][20:40, 30:34] = masks[2][21:41, 40:44] = 1.0
    masks[2][50, 70] = 0.2
    assert mask_bounds(masks, 0.5, 0.1) == (27, 17, 20, 27)  # 21 rows: a margin of 3
    assert mask_bounds(masks, 0.1, 0.1) == (27, 17, 47, 37)
    assert mask_bounds(masks, 0.5, 2.0) == (0, 0, 80, 60)
    assert mask_bounds(masks, 1.0, 0.1) is None
