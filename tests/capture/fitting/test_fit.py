"""The clip-wide fit against people whose pose, shape and camera are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks
from capture.detection.lifter import closed_form
from capture.errors import CaptureStopped, NoPersonFound
from capture.fitting.fit import ClipFit, fit_clip
from capture.fitting.observations import observe
from capture.fitting.result import Fit
from capture.fitting.world import OPENGL_TO_OPENCV, place_in_world
from scene.camera import orbit_camera
from scene.motion import Motion
from scene.rotations import axis_angle_to_matrix
from tests.capture.people import JOINT, LANDMARK, body, camera, seen_by, standing

FRAMES = 8
LEGS = [JOINT[f"{s}_{n}"] for s in ("left", "right") for n in ("hip", "knee", "ankle")]


def _people(motion: Motion) -> list[Landmarks]:
    person, view = body(), camera()
    return [seen_by(view, person, motion.pose(i)) for i in range(len(motion))]


def _fit(people: list[Landmarks | None], motion: Motion, **options) -> Fit:
    masks = [None if p is None else p.mask for p in people]
    return fit_clip(people, masks, motion.times_s, [0] * len(people), load_body_model(), **options)


def _in_camera(motion: Motion) -> np.ndarray:
    """True joints in the fit's frame."""
    view = camera()
    moved = body().skeleton.joint_transforms(motion.joint_angles, motion.root_translation)
    return (moved[..., :3, 3] @ view.rotation.T + view.translation) @ OPENGL_TO_OPENCV


def _fitted(fit: Fit) -> np.ndarray:
    person = fit.body
    shift = fit.pelvis - person.skeleton.rest_joints[0]
    return person.skeleton.joint_transforms(fit.joint_angles, shift)[..., :3, 3]


@pytest.fixture(scope="module")
def motion() -> Motion:
    return standing(FRAMES, turn_rad=1.0)  # four radians a second: a brisk turn


@pytest.fixture(scope="module")
def fit(motion) -> Fit:
    return _fit(list(_people(motion)), motion, focal_px=camera().focal_px)


def test_joints_are_found_in_place(fit, motion):
    fitted, truth = _fitted(fit), _in_camera(motion)
    # one camera can't tell a small person nearby from a tall one further away
    scale = float((fitted * truth).sum() / (fitted**2).sum())
    assert scale == pytest.approx(1.0, abs=0.04)
    off = np.linalg.norm(scale * fitted - truth, axis=-1)
    assert off[:, :22].mean() < 0.03  # absolute, with depth; hands' ends are not seen
    rooted = (_fitted(fit) - fit.pelvis[:, None]) - (_in_camera(motion) - _in_camera(motion)[:, :1])
    assert np.linalg.norm(rooted, axis=-1)[:, :22].mean() < 0.03


def test_who_tells_their_height_is_as_tall_and_as_far_away(fit, motion):
    truth = body().rest_vertices
    assert truth is not None
    for tall in (1.0, 1.05):  # the same pictures would show somebody taller further away
        height_m = tall * float(np.ptp(truth[:, 1]))
        told = _fit(list(_people(motion)), motion, focal_px=camera().focal_px, height_m=height_m)
        assert _height_m(told) == pytest.approx(height_m, abs=1e-6)
        away = np.linalg.norm(told.pelvis, axis=-1) / np.linalg.norm(
            _in_camera(motion)[:, 0], axis=-1
        )
        assert np.median(away) == pytest.approx(tall, rel=0.02)
        larger = height_m / _height_m(fit)
        np.testing.assert_allclose(told.joint_angles, fit.joint_angles)
        np.testing.assert_allclose(_fitted(told), larger * _fitted(fit), atol=1e-6)
        assert told.floor is not None
        assert fit.floor is not None
        np.testing.assert_allclose(told.floor, fit.floor * [1.0, 1.0, 1.0, larger])


def _height_m(fit: Fit) -> float:
    assert fit.body.rest_vertices is not None
    return float(np.ptp(fit.body.rest_vertices[:, 1]))


def test_as_many_frames_a_second_as_phones_film_make_nobody_slow_or_small():
    rng = np.random.default_rng(0)
    quick = standing(60, turn_rad=1.0, frames_per_second=60.0)
    people: list[Landmarks | None] = [
        replace(person, pixels=person.pixels + rng.normal(0.0, 1.0, person.pixels.shape))
        for person in _people(quick)
    ]
    fitted = _fitted(_fit(people, quick, focal_px=camera().focal_px))
    truth = _in_camera(quick)
    scale = float((fitted * truth).sum() / (fitted**2).sum())
    assert scale == pytest.approx(1.0, abs=0.05)
    assert np.linalg.norm(scale * fitted - truth, axis=-1)[:, :22].mean() < 0.025


def test_landmarks_are_explained(fit):
    assert np.nanmean(fit.landmark_error_px) < 1.0
    assert fit.focal_px == pytest.approx(camera().focal_px)


def test_the_turn_of_the_body_is_found(fit, motion):
    view = camera()
    truth = OPENGL_TO_OPENCV @ view.rotation @ axis_angle_to_matrix(motion.joint_angles[:, 0])
    cosine = np.einsum("fij,fij->f", truth, axis_angle_to_matrix(fit.joint_angles[:, 0]))
    assert np.rad2deg(np.arccos(np.clip(0.5 * (cosine - 1.0), -1, 1))).max() < 8.0


@pytest.mark.usefixtures("fewer_steps")
def test_the_same_input_gives_the_same_fit(motion):
    few = _people(standing(3))
    first, second = (_fit(list(few), standing(3)) for _ in range(2))
    assert np.array_equal(first.joint_angles, second.joint_angles)


@pytest.mark.usefixtures("fewer_steps")
def test_lost_frames_are_bridged_and_trusted_in_nothing(fit, motion):
    people: list[Landmarks | None] = list(_people(motion))
    people[4] = people[5] = None
    bridge = _fit(people, motion, focal_px=camera().focal_px)
    assert np.isnan(bridge.landmark_error_px[4:6]).all()
    assert bridge.weights[4:6].max() == 0.0
    off = np.linalg.norm(_fitted(bridge) - _fitted(fit), axis=-1)
    assert off[4:6].mean() < 0.08


def test_poses_that_the_outline_contradicts_are_taken_from_their_neighbours(motion):
    """Across a cut too, where the neighbours of the same take alone know better."""
    people = _people(motion)
    takes = np.array([0, 0, 0, 0, 0, 1, 1, 1])
    masks = [person.mask for person in people]
    seen = observe(people, masks, motion.times_s, takes, closed_form, focal_px=camera().focal_px)
    fit = ClipFit(load_body_model(), seen)
    state = fit.state
    assert not fit.outlier_frames().any()
    with torch.no_grad():
        state.joint_angles[4, LEGS] += 1.2
        state.pelvis[4, 0] += 0.4
    assert np.flatnonzero(fit.outlier_frames()).tolist() == [4]
    fit.reinitialise(fit.outlier_frames())
    angles, pelvis = state.joint_angles.detach(), state.pelvis.detach()
    np.testing.assert_allclose(angles[4], angles[3], atol=1e-4)
    np.testing.assert_allclose(pelvis[4], pelvis[3], atol=1e-4)
    assert state.frame_confidence.numpy().argmin() == 4
    assert not fit.outlier_frames().any()


@pytest.mark.usefixtures("fewer_steps")
@pytest.mark.parametrize("cut", ["by the picture", "by a table"])
def test_an_upper_body_keeps_its_legs_straight_and_stands(cut):
    slow = standing(FRAMES)
    view = orbit_camera((0.0, 1.35, 0.0), 1.6, 0.0, 0.0, 256, 192, 0.75)
    people = []
    for index in range(FRAMES):
        person = seen_by(view, body(), slow.pose(index))
        visibility, mask = person.visibility.copy(), person.mask.copy()
        visibility[LANDMARK["left_knee"] :] = 0.0
        if cut == "by a table":
            mask[180:] = 0.0
        people.append(replace(person, visibility=visibility, mask=mask))
    upper = _fit(people, slow)
    assert np.rad2deg(np.abs(upper.joint_angles[:, LEGS])).max() < 12.0
    placed = place_in_world(upper, slow.times_s)
    assert not placed.legs_seen
    assert placed.motion.confidence[:, JOINT["left_knee"]].max() == 0.0
    up = axis_angle_to_matrix(placed.motion.joint_angles[:, 0])[:, 1, 1]
    assert up.min() > 0.95  # it has not fallen over


def test_the_world_has_its_floor_under_the_feet_and_y_up(fit, motion):
    placed = place_in_world(fit, motion.times_s)
    assert placed.legs_seen
    lowest = [placed.body.posed_vertices(placed.motion.pose(i))[:, 1].min() for i in range(FRAMES)]
    assert np.abs(lowest).max() < 0.06
    head = placed.body.skeleton.joint_transforms(
        placed.motion.joint_angles, placed.motion.root_translation
    )[:, JOINT["head"], :3, 3]
    assert head[:, 1].min() > 1.3
    assert np.abs(head[:, [0, 2]]).max() < 0.2
    # the camera is on the side of +z, about where it was
    position = -placed.world_to_camera[:, :3].T @ placed.world_to_camera[:, 3]
    assert position == pytest.approx(camera().position, abs=0.4)


def test_the_world_keeps_what_the_camera_sees(fit, motion):
    placed = place_in_world(fit, motion.times_s)
    joints = placed.body.skeleton.joint_transforms(
        placed.motion.joint_angles, placed.motion.root_translation
    )[..., :3, 3]
    seen = joints @ placed.world_to_camera[:, :3].T + placed.world_to_camera[:, 3]
    assert seen @ OPENGL_TO_OPENCV == pytest.approx(_fitted(fit), abs=1e-5)


def test_nobody_and_a_stop_are_told(motion):
    with pytest.raises(NoPersonFound):
        _fit([None, None], standing(2))
    with pytest.raises(CaptureStopped):
        _fit(list(_people(standing(2))), standing(2), should_stop=lambda: True)


@pytest.mark.usefixtures("fewer_steps")
def test_standing_feet_neither_slide_nor_sink():
    motion, rng = standing(16, frames_per_second=15.0), np.random.default_rng(0)
    noisy: list[Landmarks | None] = [
        replace(
            person,
            pixels=person.pixels + rng.normal(0.0, 2.0, person.pixels.shape),
            world=person.world + rng.normal(0.0, 0.02, person.world.shape),
        )
        for person in _people(motion)
    ]
    fit = _fit(noisy, motion, focal_px=camera().focal_px)
    speed = np.linalg.norm(np.diff(_fitted(fit)[:, [10, 11]], axis=0), axis=2) * 15.0
    assert speed.mean() < 0.1
    placed = place_in_world(fit, motion.times_s)
    lowest = [
        placed.body.posed_vertices(placed.motion.pose(frame))[:, 1].min() for frame in range(16)
    ]
    assert np.abs(lowest).max() < 0.004
