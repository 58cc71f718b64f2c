"""Splats in training: none stands out of its neighbourhood where depth is uncertain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import OutdatedCheckpoint
from renderer.splats.layout import POSITION
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import first_splats
from renderer.splats.training.trained_splats import TrainedSplats
from scene.skeleton import JOINT_NAMES
from tests.renderer.studio import make_sequence

PLACE = slice(POSITION, POSITION + 3)
EVERY = np.ones(400, bool)


def make_splats(joint: int = 0) -> TrainedSplats:
    sequence, settings = make_sequence(), SplatSettings(count=400, most=400)
    first = first_splats(sequence, settings, np.random.default_rng(0))
    first = replace(first, joints=np.full_like(first.joints, joint))
    return TrainedSplats(first, sequence.body.skeleton, sequence.motion.expressions, settings)


def off_surface(splats: TrainedSplats) -> np.ndarray:
    away = splats.parameters[:, PLACE] - splats.surface[:, PLACE]
    return (away * splats.first.normals).sum(axis=1)


def test_what_stands_out_comes_back_and_what_its_neighbours_share_stays():
    splats = make_splats()
    normals = splats.first.normals
    splats.parameters[:, PLACE] += 0.03 * normals
    splats.parameters[7, PLACE] += 0.05 * normals[7]
    splats.parameters[9, PLACE] -= 0.006 * normals[9]
    before = off_surface(splats)
    splats.smooth_displacement()
    for _ in range(100):
        splats.pull_to_neighbours(EVERY)
    after = off_surface(splats)
    assert before[7] > 0.079
    assert after[7] < 0.045
    np.testing.assert_allclose(np.delete(after, 7), np.delete(before, 7), atol=1e-6)


def test_hair_may_stand_out():
    splats = make_splats(JOINT_NAMES.index("head"))
    splats.parameters[7, PLACE] += 0.05 * splats.first.normals[7]
    before = splats.parameters.copy()
    splats.smooth_displacement()
    splats.pull_to_neighbours(EVERY)
    np.testing.assert_array_equal(splats.parameters, before)


def test_nothing_is_pulled_before_the_neighbourhood_is_known():
    splats = make_splats()
    splats.parameters[7, PLACE] += 0.05 * splats.first.normals[7]
    before = splats.parameters.copy()
    splats.pull_to_neighbours(EVERY)
    np.testing.assert_array_equal(splats.parameters, before)


def test_only_splats_that_moved_are_pulled_and_never_along_the_surface():
    splats = make_splats()
    rng = np.random.default_rng(1)
    splats.parameters[:, PLACE] += rng.normal(0.0, 0.03, (400, 3)).astype(np.float32)
    before = splats.parameters.copy()
    moved = EVERY.copy()
    moved[:200] = False
    splats.smooth_displacement()
    splats.pull_to_neighbours(moved)
    change = (splats.parameters - before)[:, PLACE]
    assert not change[:200].any()
    assert np.linalg.norm(change[200:], axis=1).max() > 1e-3
    along = np.cross(change, splats.first.normals)
    np.testing.assert_allclose(along, 0.0, atol=1e-7)


def test_a_state_holds_the_neighbourhood_too():
    splats = make_splats()
    splats.parameters[7, PLACE] += 0.05 * splats.first.normals[7]
    splats.smooth_displacement()
    state, other = splats.state(), make_splats()
    other.restore(state)
    for one in (splats, other):
        one.pull_to_neighbours(EVERY)
    assert (splats.parameters != state["parameters"]).any()
    np.testing.assert_array_equal(other.parameters, splats.parameters)


def test_a_state_of_another_number_of_splats_is_refused():
    splats = make_splats()
    state = {name: of[:300] for name, of in splats.state().items()}
    with pytest.raises(OutdatedCheckpoint, match=r"must be of 400 splats.* got 300"):
        splats.restore(state)


def test_a_head_is_held_to_its_surface_and_cloth_hangs_as_it_is_filmed():
    gaps = []
    for joint in ("head", "pelvis"):
        splats = make_splats(JOINT_NAMES.index(joint))
        splats.parameters[:, PLACE] += 0.01 * splats.first.normals
        for _ in range(100):
            splats.pull_to_surface(EVERY, 1.0)
        gaps.append(off_surface(splats))
    np.testing.assert_allclose(gaps[0], 0.01 * (1.0 - 0.015) ** 100, rtol=1e-2)
    np.testing.assert_allclose(gaps[1], 0.01 * (1.0 - 0.005) ** 100, rtol=1e-2)
