"""Guessed hair becomes strands, as rich in contrast as hair that was seen; all else stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION, ROTATION
from renderer.splats.model import SplatModel
from renderer.splats.training.hair import Hair
from renderer.splats.training.strands import with_strands
from renderer.splats.training.surface_kinds import KINDS, surface_kinds
from scene.arrays import Bool, Float
from scene.camera import orbit_camera
from scene.expression import BLEND_SHAPE_COUNT
from scene.motion import Motion, Pose
from scene.rotations import quaternion_to_matrix
from scene.skeleton import HEAD, JOINT_COUNT
from tests.renderer.splats.training.heads import bald_head

PLACE, COLOURS = slice(POSITION, POSITION + 3), slice(COLOUR, COLOUR + 3)
REST = Pose(np.zeros((JOINT_COUNT, 3)), np.zeros(3), 0.0)


def somebody(contrast: float = 0.2) -> tuple[SplatModel, Bool[np.ndarray, "N"]]:
    """Filmed from the front: hair there varies by `contrast`, and is of one tone behind; which
    splats are of the scalp."""
    body, first, kinds = bald_head()
    scalp, seen = kinds == KINDS.index("scalp"), first.normals[:, 2] > 0.0
    parameters = first.parameters.copy()
    parameters[:, OPACITY] = 4.0
    shades = np.where(seen, np.random.default_rng(0).normal(1.0, contrast, len(seen)), 1.0)
    parameters[:, COLOURS] = (0.4 * shades)[:, None]
    motion = Motion.from_poses([REST])
    joints = first.joints.astype(np.uint8)
    model = SplatModel(parameters, joints, first.weights, seen, body.skeleton, motion, "of a test")
    return model, scalp


def uncovered(model: SplatModel) -> Hair:
    return Hair.none(len(model))


def over_neck(model: SplatModel) -> Hair:
    """Long hair."""
    rest = model.parameters[:, PLACE]
    kinds = surface_kinds(rest, model.joints, model.weights, model.skeleton)
    return replace(uncovered(model), covered=kinds == KINDS.index("neck"), long=True)


def strands_of(model: SplatModel, count: int) -> Float[np.ndarray, "S P"]:
    """What was laid in the place of `count` splats: the last rows."""
    return model.parameters[len(model) - 6 * count :]


def test_strands_lie_side_by_side_along_the_way_hair_falls():
    model, scalp = somebody()
    hair = scalp & ~model.seen
    drawn = with_strands(model, uncovered(model))
    assert len(drawn) == len(model) + 5 * hair.sum()
    np.testing.assert_array_equal(
        drawn.parameters[: (~hair).sum()], model.parameters[~hair], "all else stays"
    )
    assert not drawn.seen[(~hair).sum() :].any()
    strands = strands_of(drawn, hair.sum())
    sizes, turns = strands[:, LOG_SCALE : LOG_SCALE + 3], strands[:, ROTATION : ROTATION + 4]
    assert (sizes[:, 1] - sizes[:, 0]).min() > np.log(2.0), "twice as long as wide"
    axes = quaternion_to_matrix(turns.astype(np.float64))
    behind = np.abs(axes[:, 2, 2]) > 0.7
    assert np.abs(axes[behind, 1, 1]).min() > 0.6, "downwards behind"
    away = strands[:, PLACE] - np.repeat(model.parameters[hair, PLACE], 6, axis=0)
    deviation = np.exp(model.parameters[0, LOG_SCALE])
    assert np.linalg.norm(away, axis=1).max() < deviation, "outlines do not fray"


@pytest.mark.parametrize("contrast", [0.05, 0.2])
def test_tones_vary_as_those_of_hair_that_frames_show(contrast: float):
    model, scalp = somebody(contrast)
    hair = over_neck(model)
    count = int(((scalp | hair.covered) & ~model.seen).sum())
    tones = strands_of(with_strands(model, hair), count)[:, COLOUR] / 0.4
    assert abs(tones.mean() - 1.0) < 0.02
    assert contrast < tones.std() < 2.0 * contrast


def test_tones_go_on_down_the_head_and_change_across_it():
    model, scalp = somebody()
    hair = over_neck(model)
    count = int(((scalp | hair.covered) & ~model.seen).sum())
    strands = strands_of(with_strands(model, hair), count)
    place = strands[:, PLACE] - model.skeleton.rest_joints[HEAD]
    tones = strands[:, COLOUR]
    apart = place[:, None] - place[None]
    beside = (np.abs(apart[..., 1]) < 0.003) & (np.abs(np.abs(apart[..., 0]) - 0.008) < 0.002)
    below = (np.abs(apart[..., 0]) < 0.001) & (np.abs(np.abs(apart[..., 1]) - 0.008) < 0.002)
    behind = place[:, 2] < -0.05
    both = behind[:, None] & behind[None]

    def differences(pairs: Bool[np.ndarray, "S S"]) -> float:
        first, second = np.nonzero(pairs & both)
        return float(np.abs(tones[first] - tones[second]).mean())

    assert differences(below) < 0.9 * differences(beside)


def test_long_hair_has_locks_and_short_hair_none():
    model, scalp = somebody()

    def locks(hair: Hair) -> float:
        """How much of what tones differ is left in their means over a centimetre."""
        count = int(((scalp | hair.covered) & ~model.seen).sum())
        strands = strands_of(with_strands(model, hair), count)
        behind = strands[:, POSITION + 2] < model.skeleton.rest_joints[HEAD][2] - 0.05
        tones, place = strands[behind, COLOUR], strands[behind, PLACE]
        near = KDTree(place).query_ball_point(place, 0.01)
        return float(np.std([tones[one].mean() for one in near]) / tones.std())

    assert locks(over_neck(model)) > 1.3 * locks(uncovered(model))


def test_hair_without_contrast_and_strands_stay_as_they_are():
    plain, _ = somebody(contrast=0.0)
    assert with_strands(plain, uncovered(plain)) is plain
    once = with_strands(somebody()[0], uncovered(somebody()[0]))
    twice = with_strands(once, uncovered(once))
    assert len(twice) == len(once)
    again = with_strands(somebody()[0], uncovered(somebody()[0]))
    np.testing.assert_array_equal(again.parameters, once.parameters)


def test_what_hair_covers_becomes_hair_too_and_what_was_seen_does_not():
    model, scalp = somebody()
    hair = over_neck(model)
    count = int(((scalp | hair.covered) & ~model.seen).sum())
    assert len(with_strands(model, hair)) == len(model) + 5 * count


def test_albedo_normals_and_expressions_go_with_their_splats():
    model, scalp = somebody()
    hair = np.flatnonzero(scalp & ~model.seen)
    moved = np.array([hair[0], int(np.flatnonzero(~scalp)[0])], np.int32)
    offsets = np.zeros((2, BLEND_SHAPE_COUNT, 3), np.float32)
    offsets[0, 0, 1], offsets[1, 0, 1] = 0.01, 0.02
    albedo = np.full((len(model), 3), 0.25, np.float32)
    lit = replace(
        model,
        albedo=albedo,
        normals=np.tile(np.array([0.0, 0.0, 1.0], np.float32), (len(model), 1)),
        expression_splats=moved,
        expression_offsets=offsets,
    )
    drawn = with_strands(lit, uncovered(lit))
    assert drawn.albedo is not None
    assert drawn.normals is not None
    assert drawn.albedo.shape == drawn.normals.shape == (len(drawn), 3)
    tones = strands_of(drawn, len(hair))[:, COLOUR] / 0.4
    np.testing.assert_allclose(drawn.albedo[-len(tones) :, 0], 0.25 * tones**2, rtol=1e-4)
    assert sorted(drawn.expression_offsets[:, 0, 1].tolist()) == pytest.approx([0.01] * 6 + [0.02])
    picture = drawn.render(
        orbit_camera(drawn.skeleton.rest_joints[HEAD], 1.2, 3.1, 0.0, 64, 64, 0.5), REST
    )
    assert picture[..., 3].max() > 0.9
