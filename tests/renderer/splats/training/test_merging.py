"""Splats that look alike become one, and what they showed stays."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from renderer.splats.settings import SplatSettings
from renderer.splats.training.initialisation import FirstSplats, first_splats
from renderer.splats.training.merging import Grouping, groupings, joins
from scene import Pose, orbit_camera
from scene.arrays import Array
from tests.renderer.studio import make_model, make_motion, make_sequence

WIDEST_M = 0.2


def first() -> FirstSplats:
    return first_splats(
        make_sequence(), SplatSettings(count=400, most=400), np.random.default_rng(0)
    )


def joined(parameters: Array, count: int, light: Array | None = None, **options) -> Grouping:
    size = len(parameters)
    given = {"normals": np.zeros((size, 3)), "kinds": np.zeros(size, int), "widest_m": WIDEST_M}
    given |= options
    *_, last = groupings(
        parameters, light=np.ones(size) if light is None else light, counts=[count], **given
    )
    return last


def drawn(model: SplatModel, parameters: Array, joints: Array, weights: Array) -> Array:
    few = SplatModel(
        parameters,
        joints.astype(np.uint8),
        weights,
        np.ones(len(parameters), bool),
        model.skeleton,
        model.motion,
        "few",
    )
    camera = orbit_camera((0.0, 0.8, 0.0), 3.4, 0.4, 0.1, 96, 96)
    pose = make_motion(4).pose(0)
    assert isinstance(pose, Pose)
    transforms = few.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    return SplatRenderer((few,)).render(camera, [transforms]).copy()


def test_plain_cloth_joins_before_a_print():
    model = make_model(600)
    parameters = model.parameters.copy()
    printed = (parameters[:, POSITION + 1] < 0.8) & (parameters[:, POSITION + 2] > 0.0)
    rng = np.random.default_rng(0)
    parameters[printed, COLOUR : COLOUR + 3] = rng.uniform(size=(int(printed.sum()), 3))
    grouping = joined(parameters, 300)
    size = np.bincount(grouping.group)[grouping.group]
    assert len(grouping) == 300
    assert (size[printed] == 1).mean() > 0.9
    assert (size[~printed] > 1).mean() > 0.8


def test_what_shows_little_joins_first():
    model = make_model(600)
    light = np.where(model.parameters[:, POSITION] > 0.0, 10.0, 0.01)
    rng = np.random.default_rng(0)
    parameters = model.parameters.copy()
    parameters[:, COLOUR : COLOUR + 3] = rng.uniform(size=(600, 3))
    size = np.bincount(joined(parameters, 450, light).group)
    group = joined(parameters, 450, light).group
    assert (size[group][light > 1.0] == 1).mean() > 0.95


def test_numbers_fall_and_no_group_is_empty():
    model = make_model(600)
    found = list(
        groupings(
            model.parameters,
            np.zeros((600, 3)),
            np.zeros(600, int),
            np.ones(600),
            [400, 200, 100],
            WIDEST_M,
        )
    )
    assert [len(one) for one in found] == [400, 200, 100]
    for one in found:
        assert np.bincount(one.group).min() > 0
        assert (one.light == 1.0).all()


def test_kinds_stay_apart_and_none_grows_too_wide():
    model = make_model(600)
    kinds = (np.arange(600) % 7 == 0).astype(int)
    narrow = 1.5 * float(np.exp(model.parameters[0, LOG_SCALE]))
    grouping = joined(model.parameters, 1, kinds=kinds, widest_m=narrow)
    for kind in (0, 1):
        inside = set(grouping.group[kinds == kind].tolist())
        assert not inside & set(grouping.group[kinds != kind].tolist())
    assert np.bincount(grouping.group).max() <= 2


def test_merged_splats_show_what_all_did():
    model = make_model(1200)
    grouping = joined(model.parameters, 600)
    few = grouping.merged(model.parameters, grouping.turns(model.parameters))
    whole = drawn(model, model.parameters, model.joints, model.weights)
    kept = np.flatnonzero(np.bincount(grouping.group) >= 0)
    rows = np.array([np.flatnonzero(grouping.group == g)[0] for g in kept])
    merged = drawn(model, few, model.joints[rows], model.weights[rows])
    thinned = drawn(model, model.parameters[rows], model.joints[rows], model.weights[rows])
    error, of_fewer = (np.square(one - whole).mean() for one in (merged, thinned))
    assert error < 0.4 * of_fewer
    assert merged[..., 3].sum() == pytest.approx(whole[..., 3].sum(), rel=0.05)


def test_a_splat_alone_stays_as_it_is():
    parameters = make_model(50).parameters
    grouping = Grouping(np.arange(50)[::-1].copy(), np.ones(50))
    merged = grouping.merged(parameters, grouping.turns(parameters))
    np.testing.assert_array_equal(merged, parameters[::-1])


def test_first_splats_keep_unit_normals_and_weights_that_sum_to_one():
    splats = first()
    grouping = joined(splats.parameters, 150, normals=splats.normals)
    few = grouping.merged_first(splats)
    assert len(few.parameters) == 150
    np.testing.assert_allclose(np.linalg.norm(few.normals, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(few.weights.sum(axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(few.parameters[:, OPACITY], 2.0, atol=1e-5)


def test_expressions_move_what_held_splats_that_they_move():
    splats = first()
    offsets = np.zeros((2, *splats.expression_offsets.shape[1:]), np.float32)
    offsets[:, 0, 1] = 0.02
    moving = FirstSplats(
        splats.parameters,
        splats.joints,
        splats.weights,
        splats.normals,
        np.array([3, 4], np.int32),
        offsets,
    )
    group = np.maximum(np.arange(400) - 1, 0)
    group[3] = group[4] = 3
    group = np.unique(group, return_inverse=True)[1]
    few = Grouping(group, np.ones(400)).merged_first(moving)
    assert len(few.expression_splats) == 1
    np.testing.assert_allclose(few.expression_offsets[0, 0], [0.0, 0.02, 0.0], atol=1e-7)


def test_kinds_that_lie_among_one_another_join_to_few_all_the_same():
    """Threads of six kinds, so close that no splat's nearest ones are of its own kind."""
    places = np.array([[0.01 * i, 0.001 * kind, 0.0] for i in range(40) for kind in range(6)])
    parameters = make_model(len(places)).parameters
    parameters[:, POSITION : POSITION + 3] = places
    kinds, light = np.tile(np.arange(6), 40), np.ones(len(places))
    pairs = joins(parameters, np.tile([0.0, 0.0, 1.0], (len(places), 1)), kinds, light, 6)
    assert len(pairs) == len(places) - 6
    kind_of = list(kinds)
    for first, second in pairs:
        assert kind_of[first] == kind_of[second]
        kind_of.append(kind_of[first])
