"""Clothes lie where clothes lie, on every performer: shirts on trunks, never on faces."""

from __future__ import annotations

import numpy as np
import pytest

from capture.studio.outfit import albedo
from capture.studio.performer import StudioPerformer, make_performer
from scene import JOINT_NAMES
from tests.capture.sequences import surface

SEEDS = range(8)


def painted(performer: StudioPerformer) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rest vertices, their colours, and the names of the joints that move them most."""
    vertices, _, _ = surface(performer.body)
    joints = performer.body.skeleton.rest_joints
    colours = albedo(
        performer.outfit, vertices, performer.rest_normals, performer.vertex_joint, joints
    )
    return vertices, colours, np.array(JOINT_NAMES)[performer.vertex_joint]


def is_colour(colours: np.ndarray, *known: np.ndarray) -> np.ndarray:
    """Which of `colours` [N 3] are one of `known`."""
    return np.any([np.isclose(colours, one, atol=1e-4).all(axis=1) for one in known], axis=0)


@pytest.mark.parametrize("seed", SEEDS)
def test_faces_hands_and_legs_wear_no_shirt(seed):
    performer = make_performer(seed)
    _, colours, joint = painted(performer)
    ground, stripe = performer.outfit.shirt
    shirt = is_colour(colours, ground, stripe, 0.5 * (ground + stripe), 0.6 * stripe)
    bare = ("head", "left_hand", "right_hand", "left_knee", "right_knee", "left_foot", "right_foot")
    assert not shirt[np.isin(joint, bare)].any()
    assert shirt[np.isin(joint, ("spine1", "spine2", "spine3"))].mean() > 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_faces_are_mostly_skin_below_the_hair(seed):
    performer = make_performer(seed)
    vertices, colours, joint = painted(performer)
    head = performer.body.skeleton.rest_joints[JOINT_NAMES.index("head")]
    face = (joint == "head") & (vertices[:, 2] > head[2] + 0.03) & (vertices[:, 1] < head[1] + 0.08)
    shade = colours[face] / performer.outfit.skin
    skin = (np.ptp(shade, axis=1) < 1e-3) & (shade[:, 0] > 0.79) & (shade[:, 0] < 1.001)
    assert skin.mean() > 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_stripes_of_a_trunk_are_level_down_to_the_belt(seed):
    """Wide hips are no arms, whose stripes run across."""
    performer = make_performer(seed)
    outfit = performer.outfit
    vertices, colours, joint = painted(performer)
    joints = performer.body.skeleton.rest_joints
    above_belt = vertices[:, 1] - joints[0, 1] - 0.06
    low = np.isin(joint, ("pelvis", "spine1")) & (above_belt > 0.001) & (above_belt < 0.1)
    striped = np.mod(vertices[:, 1], outfit.stripe_m) < 0.42 * outfit.stripe_m
    if outfit.checked:
        columns = np.mod(vertices[:, 0], outfit.stripe_m) < 0.42 * outfit.stripe_m
        expected = np.where((columns & striped)[:, None], 0.6 * outfit.shirt[1], 0.0)
        both = 0.5 * (outfit.shirt[0] + outfit.shirt[1])
        expected = np.where((columns & ~striped)[:, None], both, expected)
        expected = np.where((~columns & striped)[:, None], outfit.shirt[1], expected)
        expected = np.where((~columns & ~striped)[:, None], outfit.shirt[0], expected)
    else:
        expected = np.where(striped[:, None], outfit.shirt[1], outfit.shirt[0])
    plain = np.isclose(colours, expected, atol=1e-4).all(axis=1)
    seam = np.isclose(colours, 0.45 * expected, atol=1e-4).all(axis=1)
    button = is_colour(colours, np.array([0.97, 0.95, 0.88]))
    assert low.sum() > 50
    assert (plain | seam | button)[low].all()


def test_performers_differ_in_shape_and_dress():
    performers = [make_performer(seed) for seed in SEEDS]
    heights = [performer.body.skeleton.rest_joints[15, 1] for performer in performers]
    assert np.ptp(heights) > 0.05
    assert len({performer.outfit.shirt.tobytes() for performer in performers}) == len(SEEDS)
    assert {performer.outfit.checked for performer in performers} == {True, False}
    assert {performer.outfit.long_sleeves for performer in performers} == {True, False}
