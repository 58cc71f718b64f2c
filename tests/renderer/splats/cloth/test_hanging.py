"""Splats on cloth: they go and turn with it, gradients come back, and live cloth swings as in a
clip."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.cloth.hanging import (
    NO_CLOTH,
    BoundSplats,
    ClothSwing,
    HungCloth,
    MotionPath,
    hung_from,
)
from renderer.splats.layout import POSITION, ROTATION
from scene.rotations import axis_angle_to_matrix, quaternion_to_matrix
from tests.renderer.splats.cloth.wear import make_loose_model, make_tubes
from tests.renderer.studio import make_model, make_motion

MODEL = make_loose_model()
PLACE, TURN = slice(POSITION, POSITION + 3), slice(ROTATION, ROTATION + 4)


def bound() -> BoundSplats:
    assert MODEL.cloth is not None
    return BoundSplats(MODEL.parameters, MODEL.quads, MODEL.cloth)


def hung_on(vertices: np.ndarray) -> np.ndarray:
    moved, splats = MODEL.parameters.copy(), bound()
    splats.hang(moved, MODEL.parameters[splats.rows], vertices)
    return moved


def test_at_rest_they_are_where_they_were():
    assert MODEL.cloth is not None
    moved = hung_on(MODEL.cloth.rest)
    np.testing.assert_allclose(moved, MODEL.parameters, atol=1e-6)


def test_on_cloth_that_moves_stiffly_they_move_stiffly_and_others_stay():
    assert MODEL.cloth is not None
    turn, shift = axis_angle_to_matrix(np.array([0.3, -0.8, 2.4])), np.array([0.1, -0.2, 0.3])
    moved, on = hung_on(MODEL.cloth.rest @ turn.T + shift), MODEL.quads != NO_CLOTH
    places = MODEL.parameters[on, PLACE] @ turn.T + shift
    np.testing.assert_allclose(moved[on, PLACE], places, atol=1e-5)
    axes = quaternion_to_matrix(MODEL.parameters[on, TURN].astype(np.float64))
    turned = quaternion_to_matrix(moved[on, TURN].astype(np.float64))
    np.testing.assert_allclose(turned, turn @ axes, atol=1e-5)
    np.testing.assert_array_equal(moved[~on], MODEL.parameters[~on])


def test_a_gradient_taken_back_is_that_by_finite_differences():
    assert MODEL.cloth is not None
    rng, splats = np.random.default_rng(1), bound()
    hung = MODEL.cloth.rest + rng.normal(scale=0.03, size=MODEL.cloth.rest.shape)
    pull = np.zeros(MODEL.parameters.shape, np.float32)
    pull[:, POSITION : ROTATION + 4] = rng.normal(size=(len(MODEL), ROTATION + 4))
    taken = pull.copy()
    splats.take_back(taken, hung)
    row, number = splats.rows[17], 17
    for column in (*range(POSITION, POSITION + 3), *range(ROTATION, ROTATION + 4)):
        values = []
        for off in (-0.05, 0.05):
            own = MODEL.parameters[splats.rows].copy()
            own[number, column] += off
            moved = MODEL.parameters.copy()
            splats.hang(moved, own, hung)
            values.append(float((moved[row].astype(np.float64) * pull[row]).sum()))
        found = (values[1] - values[0]) / 0.1
        assert found == pytest.approx(float(taken[row, column]), abs=2e-4)
    on_body = MODEL.quads == NO_CLOTH
    np.testing.assert_array_equal(taken[on_body], pull[on_body])


def test_hung_cloth_is_carried_back_to_where_it_is_in_the_world():
    cloth, motion = make_tubes(), make_motion(4)
    pose = motion.pose(2)
    posed = MODEL.skeleton.skinning_transforms(pose.joint_angles, pose.root_translation)
    world = np.random.default_rng(0).normal(size=cloth.rest.shape)
    hung = hung_from(cloth, world, posed)
    carried = posed[cloth.carriers]
    again = np.einsum("vij,vj->vi", carried[:, :3, :3], hung) + carried[:, :3, 3]
    np.testing.assert_allclose(again, world, atol=1e-9)


def test_live_it_swings_as_in_the_clip_and_settles_after_a_gap():
    cloth, motion = make_tubes(), make_motion(8)
    times = np.arange(0.0, 0.5, 1.0 / 30.0)
    path, swing = MotionPath.of(motion, MODEL.skeleton, times), ClothSwing(make_tubes())
    live = np.stack(
        [swing.hung(posed, float(t)) for posed, t in zip(path.posed, times, strict=True)]
    )
    of_clip, still = path.hung(cloth), ClothSwing(cloth).hung(path.posed[-1], 0.0)
    swung = np.abs(of_clip[-1] - still).max()
    assert swung > 0.02
    assert np.abs(live - of_clip).max() < 0.3 * swung
    np.testing.assert_allclose(swing.hung(path.posed[-1], 60.0), still, atol=1e-9)


def test_two_models_keep_their_own_cloth():
    tight, other = make_model(), make_loose_model()
    together = HungCloth((tight, MODEL, other))
    assert together.any
    parameters = np.concatenate([tight.parameters, MODEL.parameters, other.parameters])
    before = parameters.copy()
    assert MODEL.cloth is not None
    together.move(parameters, [None, None, MODEL.cloth.rest + np.array([0.0, -0.1, 0.0])])
    start = len(tight) + len(MODEL)
    np.testing.assert_allclose(parameters[:start], before[:start], atol=1e-6)
    fell = (parameters - before)[start:][other.quads != NO_CLOTH]
    np.testing.assert_allclose(fell[:, POSITION + 1], -0.1, atol=1e-5)
    assert not HungCloth((tight,)).any
