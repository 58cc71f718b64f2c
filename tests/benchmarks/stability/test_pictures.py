"""Masks and pictures lose what they are said to lose, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stability.pictures import (
    CROPS,
    arc_seen,
    chair_in_mask,
    cropped_person,
    dark_scene,
    dilated_mask,
    eroded_mask,
    frame_count,
    holed_mask,
    lost_masks,
    object_in_front,
    resolution,
    sensor_noise,
    video_compression,
)
from renderer.evaluation.evaluate import side_of_body
from tests.benchmarks.stability.people import subject

RNG = np.random.default_rng


def area(material) -> float:
    return float(sum(frame.mask.sum() for frame in material.train))


def test_masks_grow_and_shrink_with_what_is_cut_out():
    somebody = subject()
    wide, narrow = (change(somebody, 16.0, RNG(0)) for change in (dilated_mask, eroded_mask))
    assert area(narrow) < 0.9 * area(somebody.material) < 0.8 * area(wide)
    for frame in narrow.train:
        assert not frame.image[frame.mask == 0.0].any()
    before, after = somebody.material.train[0], wide.train[0]
    np.testing.assert_allclose(after.image[before.mask == 1.0], before.image[before.mask == 1.0])
    assert after.image[(before.mask == 0.0) & (after.mask > 0.9)].mean() > 0.1  # the room


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_holes_take_as_much_as_they_are_said_to(share: float):
    somebody = subject()
    left = area(holed_mask(somebody, share, RNG(0))) / area(somebody.material)
    assert 1.0 - share - 0.12 < left <= 1.0 - share


def test_nobody_is_found_in_a_share_of_the_frames():
    lost = lost_masks(subject(), 0.5, RNG(0))
    assert sum(not frame.mask.any() for frame in lost.train) == 6
    assert not any(frame.image.any() for frame in lost.train if not frame.mask.any())


def test_fewer_frames_are_spread_over_the_clip():
    times = [frame.pose.time_s for frame in frame_count(subject(), 4.0, RNG(0)).train]
    np.testing.assert_allclose(times, [0.0, 0.3, 0.6, 0.9])
    assert len(frame_count(subject(), 60.0, RNG(0)).train) == 12


def test_an_arc_has_only_frames_that_face_the_camera():
    somebody = subject()
    half = arc_seen(somebody, 180.0, RNG(0)).train
    skeleton = somebody.material.body.skeleton
    sides = [side_of_body(frame.camera, frame.pose, skeleton) for frame in half]
    assert 5 <= len(half) <= 7
    assert np.abs(sides).max() <= np.pi / 2.0 + 1e-9
    least = arc_seen(somebody, 0.0, RNG(0)).train
    assert len(least) in (2, 3)  # as many as training asks for, or one that is as near
    for frame in least:
        assert side_of_body(frame.camera, frame.pose, skeleton) == pytest.approx(0.0, abs=0.6)


def test_what_is_judged_ends_where_the_picture_does():
    somebody = subject()
    heights = []
    for step in range(len(CROPS)):
        material = cropped_person(somebody, step, RNG(0))
        for frame in (*material.train, *material.judged):
            assert frame.image.shape[:2] == frame.mask.shape
            assert frame.mask.shape == (frame.camera.height, frame.camera.width)
        heights.append(material.judged[0].camera.height)
    assert heights[0] == 48
    assert max(heights[1:]) < 36


def test_noise_has_its_strength_inside_the_person_alone():
    somebody = subject()
    before, after = somebody.material.train[0], sensor_noise(somebody, 8.0, RNG(0)).train[0]
    inside = (before.mask > 0.99)[..., None] & (before.image > 0.15) & (before.image < 0.85)
    off = 255.0 * (after.image - before.image)
    assert inside.sum() > 30
    assert off[inside].std() == pytest.approx(8.0, rel=0.35)
    assert not off[before.mask == 0.0].any()


def test_less_light_is_more_noise():
    somebody = subject()
    clean = somebody.material.train[0]
    errors = [
        float(np.abs(dark_scene(somebody, stops, RNG(0)).train[0].image - clean.image).mean())
        for stops in (2.0, 6.0)
    ]
    assert errors[0] < 0.5 * errors[1]


def test_a_smaller_picture_sees_the_same():
    somebody = subject()
    small = resolution(somebody, 0.5, RNG(0)).train[0]
    whole = somebody.material.train[0]
    assert small.mask.shape == (24, 24)
    assert 4.0 * small.mask.sum() == pytest.approx(whole.mask.sum(), rel=0.02)
    point = np.array([0.1, 0.9, 0.0])
    np.testing.assert_allclose(2.0 * small.camera.project(point)[0], whole.camera.project(point)[0])


def test_a_chair_stands_still_beside_whoever_moves_and_is_part_of_the_mask():
    somebody = subject()
    seated = chair_in_mask(somebody, 0.4, RNG(0))
    added = [
        after.mask - before.mask
        for before, after in zip(somebody.material.train, seated.train, strict=True)
    ]
    free = np.all([frame.mask == 0.0 for frame in somebody.material.train], axis=0)
    assert added[0][free].max() > 0.9
    for before, after, more in zip(somebody.material.train, seated.train, added, strict=True):
        np.testing.assert_array_equal(more[free], added[0][free])
        assert np.all(after.mask >= before.mask)
        assert after.mask.max() <= 1.0
        chair = more > 0.9
        assert np.ptp(after.image[chair], axis=1).mean() > 0.1  # brown, neither grey nor black
        person = before.mask > 0.99  # before it
        np.testing.assert_allclose(after.image[person], before.image[person], atol=0.01)


def test_a_chair_stands_out_by_its_share_of_the_width():
    somebody = subject()
    clean = somebody.material.train[0].mask.sum()
    more = [area(chair_in_mask(somebody, share, RNG(0))) for share in (0.0, 0.2, 0.4)]
    small, large = more[1] - more[0], more[2] - more[0]
    assert more[0] == area(somebody.material)
    assert large == pytest.approx(2.0 * small, rel=0.35)
    assert 0.02 < large / (len(somebody.material.train) * clean) < 0.4


def test_fewer_bits_of_video_are_a_worse_picture():
    somebody = subject()
    errors = []
    for bits in (2.0, 0.2, 0.05):
        coded = video_compression(somebody, bits, RNG(0)).train
        pairs = list(zip(coded, somebody.material.train, strict=True))
        for after, before in pairs:
            np.testing.assert_array_equal(after.mask, before.mask)
            assert not after.image[before.mask == 0.0].any()
        errors.append(float(np.mean([np.abs(a.image - b.image).mean() for a, b in pairs])))
    assert 0.0 < errors[0] < 0.7 * errors[1] < 0.7 * errors[2]


def test_what_a_pole_hides_is_gone():
    somebody = subject()
    share = area(object_in_front(somebody, 0.4, RNG(0))) / area(somebody.material)
    assert 0.2 < share < 0.75
