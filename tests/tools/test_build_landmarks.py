"""Offsets learnt from what an estimator saw: known ones come back, outliers or not."""

from __future__ import annotations

import numpy as np
import pytest

from capture.body.landmark_names import LANDMARK_COUNT, LANDMARK_NAMES
from capture.body.landmarks import MIRROR, load_body_landmarks
from capture.body.model import load_body_model
from capture.detection.landmarks import Landmarks
from scene.skeleton import JOINT_NAMES
from tests.capture.people import body, camera, seen_by, standing
from tools.build_landmarks import landmarks_of, shape_of, sights_in, solve_offsets


def _sights(offsets: np.ndarray, noise_px: float) -> list:
    """What an estimator would report whose landmarks lie off ours by `offsets`."""
    marks, rng, view, person = load_body_landmarks(), np.random.default_rng(0), camera(), body()
    found = [[] for _ in range(LANDMARK_COUNT)]
    for pose in map(standing(24, turn_rad=6.0).pose, range(24)):
        seen = seen_by(view, person, pose)
        skeleton = person.skeleton
        moved = skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)[marks.joints]
        places = np.einsum("nij,nj->ni", moved[:, :3, :3], marks.rest + offsets) + moved[:, :3, 3]
        pixels = view.project(places)[0] + rng.normal(0.0, noise_px, (LANDMARK_COUNT, 2))
        pixels[rng.uniform(size=LANDMARK_COUNT) < 0.1] += 60.0  # taken for something else
        said = Landmarks(pixels, seen.world, seen.visibility, seen.mask)
        sights = sights_in(said, view, pose, skeleton, marks.rest, marks.joints)
        for landmark, sight in enumerate(sights):
            found[landmark].append(sight)
    return found


def test_offsets_are_found_again():
    rng = np.random.default_rng(1)
    offsets = rng.uniform(-0.03, 0.03, (LANDMARK_COUNT, 3))
    for landmark, partner in enumerate(MIRROR):
        offsets[partner] = offsets[landmark] * [-1.0, 1.0, 1.0]
    offsets[0, 0] = 0.0  # the nose is its own mirror image
    np.testing.assert_allclose(solve_offsets(_sights(offsets, 0.2)), offsets, atol=0.004)


def test_sides_mirror_each_other():
    solved = solve_offsets(_sights(np.full((LANDMARK_COUNT, 3), 0.01), 0.5))
    left, right = (LANDMARK_NAMES.index(f"{side}_heel") for side in ("left", "right"))
    np.testing.assert_allclose(solved[left], solved[right] * [-1.0, 1.0, 1.0])


def test_the_shape_of_a_skeleton_is_found():
    shape = np.array([0.05, -0.2, 0.1, 0.15, -0.1])
    skeleton = load_body_model().body(shape).skeleton
    assert shape_of(skeleton) == pytest.approx(shape, abs=1e-3)


def test_landmarks_stand_on_the_floor_with_their_body():
    marks, model = load_body_landmarks(), load_body_model()
    tall = model.body(np.array([0.2, 0.0, 0.0, 0.0, 0.0])).skeleton
    places = landmarks_of(tall, marks)
    wrist = JOINT_NAMES.index("left_wrist")
    away = places[LANDMARK_NAMES.index("left_wrist")] - tall.rest_joints[wrist]
    mean = marks.rest[LANDMARK_NAMES.index("left_wrist")] - model.rest_joints[wrist]
    np.testing.assert_allclose(away, mean, atol=1e-6)
