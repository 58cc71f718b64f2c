"""Skin that frames only graze."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.splats.layout import COLOUR, PARAMETERS
from renderer.splats.training.evidence import Evidence
from renderer.splats.training.smooth_skin import smooth_skin
from renderer.splats.training.surface_kinds import KINDS

SIDE = 20
FACE, SCALP, NECK = (KINDS.index(kind) for kind in ("face", "scalp", "neck"))
COLOURS = slice(COLOUR, COLOUR + 3)


@pytest.fixture
def cheek() -> tuple[np.ndarray, np.ndarray]:
    """Splats on a square of 4 cm, light brown with dark spots; how well frames face each, from
    the left, wholly, to the right, not at all."""
    x, y = np.meshgrid(np.linspace(0.0, 0.04, SIDE), np.linspace(0.0, 0.04, SIDE))
    splats = np.zeros((SIDE * SIDE, PARAMETERS), np.float32)
    splats[:, 0], splats[:, 1] = x.ravel(), y.ravel()
    splats[:, COLOURS] = (0.7, 0.5, 0.4)
    spots = np.random.default_rng(0).uniform(size=len(splats)) < 0.1
    splats[spots, COLOURS] = 0.1
    return splats, np.where(x.ravel() < 0.02, 1.0, 0.0).astype(np.float32)


def roughness(splats: np.ndarray, rows: np.ndarray) -> float:
    return float(splats[rows, COLOUR].std())


def smoothed(splats: np.ndarray, facing: np.ndarray, kind: int = FACE, **changes) -> np.ndarray:
    evidence = Evidence(changes.get("pixels", np.ones_like(facing)), facing, 1.0)
    covered = changes.get("covered", np.zeros(len(splats), bool))
    return smooth_skin(splats, evidence, np.full(len(splats), kind), covered)


@pytest.mark.parametrize("kind", [FACE, NECK])
def test_spots_go_where_skin_is_grazed_and_stay_where_it_is_faced(cheek, kind):
    splats, facing = cheek
    before = splats.copy()
    smooth = smoothed(splats, facing, kind)
    np.testing.assert_array_equal(splats, before)
    assert roughness(smooth, facing == 0.0) < 0.3 * roughness(splats, facing == 0.0)
    np.testing.assert_allclose(
        smooth[facing == 1.0, COLOURS], splats[facing == 1.0, COLOURS], atol=0.02
    )
    np.testing.assert_array_equal(smooth[:, :COLOUR], splats[:, :COLOUR])
    # between the skin's colour and the spots'
    assert 0.1 < smooth[facing == 0.0, COLOUR].min() < smooth[:, COLOUR].max() <= 0.71


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        (SCALP, {}),
        (FACE, {"covered": np.ones(SIDE * SIDE, bool)}),
        (FACE, {"pixels": np.zeros(SIDE * SIDE)}),
    ],
    ids=["hair", "skin that hair covers", "sides that are guessed"],
)
def test_nothing_but_seen_skin_changes(cheek, kind, changes):
    splats, facing = cheek
    np.testing.assert_array_equal(smoothed(splats, facing, kind, **changes), splats)


def test_hair_that_lies_on_a_cheek_keeps_its_colour(cheek):
    splats, _ = cheek
    splats[:, COLOURS] = np.where(splats[:, :1] < 0.02, 0.7, 0.1)
    smooth = smoothed(splats, np.zeros(len(splats), np.float32))
    far = np.abs(splats[:, 0] - 0.02) > 0.01
    assert smooth[far & (splats[:, 0] < 0.02), COLOUR].min() > 0.5
    assert smooth[far & (splats[:, 0] > 0.02), COLOUR].max() < 0.3
