"""Splats of a hand that are no colour of its skin were never seen."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.layout import COLOUR, PARAMETERS
from renderer.splats.training.evidence import Evidence
from renderer.splats.training.strays import strays_on_hands
from scene.arrays import Array, Bool
from scene.skeleton import JOINT_NAMES

LEFT, RIGHT, FOREARM = map(JOINT_NAMES.index, ("left_hand", "right_hand", "left_elbow"))
PALE, DARK = (0.85, 0.62, 0.55), (0.38, 0.25, 0.2)
BLACK_CLOTH, ORANGE_CLOTH, GREY_CLOTH = (0.06, 0.06, 0.07), (0.9, 0.5, 0.1), (0.33, 0.36, 0.37)
SKINS = 200


def found(joint: int, skin, odd, *, shown: bool = True) -> Bool[Array, "N"]:
    """Of a hand of many splats of `skin`, a little lighter and darker, and one that is `odd`."""
    rng = np.random.default_rng(0)
    parameters = np.zeros((SKINS + 1, PARAMETERS), np.float32)
    light = rng.uniform(0.75, 1.1, (SKINS, 1))
    parameters[:SKINS, COLOUR : COLOUR + 3] = np.minimum(light * np.array(skin), 1.0)
    parameters[SKINS, COLOUR : COLOUR + 3] = odd
    pixels = np.full(SKINS + 1, float(shown))
    joints = np.full((SKINS + 1, 4), joint)
    weights = np.tile((0.7, 0.3, 0.0, 0.0), (SKINS + 1, 1))
    return strays_on_hands(parameters, Evidence.of(pixels, pixels), joints, weights)


@pytest.mark.parametrize("skin", [PALE, DARK])
@pytest.mark.parametrize("joint", [LEFT, RIGHT])
@pytest.mark.parametrize("cloth", [BLACK_CLOTH, ORANGE_CLOTH])
def test_the_shirts_colour_is_no_fingers(joint: int, skin, cloth):
    assert found(joint, skin, cloth).tolist() == [False] * SKINS + [True]


def test_grey_cloth_is_no_pale_skin():
    assert found(LEFT, PALE, GREY_CLOTH)[-1]


@pytest.mark.parametrize("skin", [PALE, DARK])
@pytest.mark.parametrize("light", [0.6, 1.15])
def test_shadows_and_highlights_are_skin(skin, light: float):
    assert not found(LEFT, skin, np.minimum(light * np.array(skin), 1.0)).any()


def test_sleeves_may_have_any_colour():
    assert not found(FOREARM, PALE, BLACK_CLOTH).any()


def test_of_a_hand_that_nothing_shows_nothing_is_said():
    assert not found(LEFT, PALE, BLACK_CLOTH, shown=False).any()


def test_evidence_of_strays_is_none():
    pixels = np.array([1.0, 0.8, 0.6])
    left = Evidence.of(pixels, pixels).without(np.array([False, True, False]))
    assert left.seen.tolist() == [True, False, True]
    assert left.facing.tolist() == [1.0, 0.0, 0.6]
