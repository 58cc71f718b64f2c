"""Masks: edges follow the picture, other people and furniture stay out."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from capture.landmarks import Landmarks
from capture.masks import bone_points, keep_connected, refine_mask
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
