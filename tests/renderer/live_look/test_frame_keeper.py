"""Pictures are kept for sides that a model has not seen, the best of each, if they are any good."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from renderer.live_look.frame_keeper import (
    A_SIDE,
    MOST,
    SECTOR_DEG,
    BestOfSides,
    Fitness,
    FrameKeeper,
    KeptFrame,
    Side,
    side_of,
    sides_shown,
)
from renderer.live_look.picture import WebcamPicture
from renderer.splats.model import SplatModel
from scene.camera import Camera, look_at
from scene.motion import Pose
from scene.skeleton import HEAD
from tests.capture.people import body
from tests.renderer.live_look.people import person_in_checks, seen_from

FIT = Fitness(sharpness=200.0, luma=0.4, clipped=0.0, soft=0.05, overlap=0.95, difference=0.03)
EMPTY = WebcamPicture(
    np.zeros((8, 8, 3), np.uint8),
    np.zeros((8, 8), np.uint8),
    Camera.from_field_of_view(look_at((0.0, 1.0, 3.0), (0.0, 1.0, 0.0)), 8, 8, 0.6),
    Pose.rest(),
)


def offered(time_s: float, sharpness: float, *sides: Side) -> KeptFrame:
    picture = replace(EMPTY, pose=Pose.rest(time_s))
    return KeptFrame(picture, sides, replace(FIT, sharpness=sharpness))


AZIMUTHS = st.integers(-6, 5).map(lambda sector: SECTOR_DEG * sector)
SIDES = st.one_of(
    st.builds(Side, st.just("head"), AZIMUTHS, st.integers(-1, 1)),
    st.builds(Side, st.just("trunk"), AZIMUTHS, st.just(0)),
)
FRAMES = st.lists(st.tuples(st.floats(0.0, 2000.0), st.lists(SIDES, max_size=2)), max_size=400).map(
    lambda ones: [offered(float(n), sharp, *sides) for n, (sharp, sides) in enumerate(ones)]
)


def kept_of(frames: list[KeptFrame]) -> list[KeptFrame]:
    best = BestOfSides()
    for frame in frames:
        best.offer(frame)
    return best.frames


@given(FRAMES)
def test_the_number_has_a_limit_and_each_side_its_best(frames):
    kept = kept_of(frames)
    assert len(kept) <= MOST
    assert all(one.fitness.sufficient and one.sides for one in kept)
    times = [one.picture.pose.time_s for one in kept]
    assert times == sorted(set(times))
    fit = [one for one in frames if one.fitness.sufficient]
    assert sides_shown(kept) == sides_shown(fit), "no side is lost"
    for side in sides_shown(fit):
        best = max(one.fitness.score for one in fit if side in one.sides)
        assert best == max(one.fitness.score for one in kept if side in one.sides)


FEW_SIDES = st.lists(
    st.tuples(st.floats(31.0, 2000.0), st.integers(0, 5).map(lambda n: Side("head", 30 * n, 0))),
    max_size=100,
).map(lambda ones: [offered(float(n), sharp, side) for n, (sharp, side) in enumerate(ones)])


@given(FEW_SIDES.flatmap(lambda ones: st.tuples(st.just(ones), st.permutations(ones))))
def test_which_are_kept_does_not_depend_on_their_order(both):
    frames, shuffled = both
    kept = kept_of(frames)
    assert kept_of(shuffled) == kept
    for side in sides_shown(frames):
        scores = sorted((one.fitness.score for one in frames if side in one.sides), reverse=True)
        mine = sorted((one.fitness.score for one in kept if side in one.sides), reverse=True)
        assert mine == scores[:A_SIDE]


@pytest.mark.parametrize(
    "fault",
    [
        {"sharpness": 5.0},
        {"luma": 0.03},
        {"luma": 0.97},
        {"clipped": 0.6},
        {"soft": 0.5},
        {"overlap": 0.5},
        {"difference": 0.3},
    ],
    ids=str,
)
def test_what_is_no_good_is_not_kept(fault):
    side = Side("head", 60, 0)
    bad = KeptFrame(EMPTY, (side,), replace(FIT, **fault))
    assert kept_of([bad]) == []
    assert len(kept_of([replace(bad, fitness=FIT)])) == 1


def test_a_score_prefers_the_sharper_the_better_covered_and_the_nearer():
    better = [{"sharpness": 400.0}, {"overlap": 0.99}, {"difference": 0.01}]
    assert all(replace(FIT, **one).score > FIT.score for one in better)


@pytest.mark.parametrize("degrees", [-150, -60, -30, 0, 30, 90, 150])
@pytest.mark.parametrize("elevation", [-1, 0, 1])
@pytest.mark.parametrize("turned", [0.0, 1.2])
def test_a_side_is_where_the_camera_is_from_the_part_however_it_is_turned(
    degrees, elevation, turned
):
    skeleton = body().skeleton
    angles = np.zeros((24, 3))
    angles[0, 1] = turned
    pose = Pose(angles, np.array([0.3, 0.0, -0.2]))
    at = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[HEAD, :3, 3]
    azimuth = np.radians(degrees) + turned
    way = np.array([np.sin(azimuth), elevation * 0.8, np.cos(azimuth)])
    camera = Camera.from_field_of_view(look_at(at + 2.0 * way, at), 64, 64, 0.6)
    assert side_of("head", skeleton, pose, camera) == Side("head", degrees, elevation)


@pytest.fixture(scope="module")
def model() -> SplatModel:
    return person_in_checks()


def test_a_picture_from_the_front_shows_nothing_new_and_one_from_beside_does(model):
    keeper = FrameKeeper(model)
    front, beside = (keeper.look_at(seen_from(model, degrees)) for degrees in (0, 90))
    assert front is not None
    assert beside is not None
    assert front.sides == ()
    assert beside.sides == (Side("head", 90, 0), Side("trunk", 90, 0))
    assert beside.fitness.sufficient, beside.fitness
    assert beside.fitness.overlap > 0.9
    assert beside.fitness.difference < 0.02


def test_a_picture_comes_to_the_exposure_of_the_model_and_its_matte_stays(model):
    picture = seen_from(model, 60)
    darker = replace(picture, rgb=(0.8 * picture.rgb).astype(np.uint8))
    found = FrameKeeper(model).look_at(darker)
    assert found is not None
    inside = picture.matte > 250
    before = np.abs(darker.rgb[inside].astype(float) - picture.rgb[inside]).mean()
    after = np.abs(found.picture.rgb[inside].astype(float) - picture.rgb[inside]).mean()
    assert after < 0.15 * before
    assert (found.picture.matte == picture.matte).all()


def test_faults_are_found_in_pictures(model):
    keeper, good = FrameKeeper(model), seen_from(model, 90)

    def fit(picture: WebcamPicture) -> bool:
        found = keeper.look_at(picture)
        return found is not None and found.fitness.sufficient

    assert fit(good)
    assert not fit(replace(good, rgb=np.asarray(cv2.GaussianBlur(good.rgb, (0, 0), 6))))
    assert not fit(replace(good, rgb=good.rgb // 12))
    shifted = np.roll(good.matte, 60, axis=1)
    assert not fit(replace(good, matte=shifted, rgb=np.roll(good.rgb, 60, axis=1)))
    assert keeper.look_at(replace(good, matte=np.zeros_like(good.matte))) is None
