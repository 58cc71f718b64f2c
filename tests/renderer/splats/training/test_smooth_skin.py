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
SLIVER = 0.06
"""Evidence, px: just enough to count as seen."""


@pytest.fixture
def cheek() -> tuple[np.ndarray, np.ndarray]:
    """Splats on a square of 4 cm, light brown with dark spots; how well frames show each: from the
    left half, wholly, on the right, a sliver."""
    x, y = np.meshgrid(np.linspace(0.0, 0.04, SIDE), np.linspace(0.0, 0.04, SIDE))
    splats = np.zeros((SIDE * SIDE, PARAMETERS), np.float32)
    splats[:, 0], splats[:, 1] = x.ravel(), y.ravel()
    splats[:, COLOURS] = (0.7, 0.5, 0.4)
    spots = np.random.default_rng(0).uniform(size=len(splats)) < 0.1
    splats[spots, COLOURS] = 0.1
    return splats, np.where(x.ravel() < 0.02, 1.0, SLIVER).astype(np.float32)


def roughness(splats: np.ndarray, rows: np.ndarray) -> float:
    return float(splats[rows, COLOUR].std())


def smoothed(
    splats: np.ndarray, pixels: np.ndarray, kind: int = FACE, covered: np.ndarray | None = None
) -> np.ndarray:
    evidence = Evidence(pixels, np.zeros_like(pixels), 1.0)
    bare = np.zeros(len(splats), bool)
    return smooth_skin(
        splats, evidence, np.full(len(splats), kind), bare if covered is None else covered
    )


@pytest.mark.parametrize("kind", [FACE, NECK])
def test_spots_go_where_frames_show_a_sliver_and_stay_where_they_show_skin(cheek, kind):
    splats, pixels = cheek
    before, grazed = splats.copy(), pixels == SLIVER
    smooth = smoothed(splats, pixels, kind)
    np.testing.assert_array_equal(splats, before)
    assert roughness(smooth, grazed) < 0.3 * roughness(splats, grazed)
    np.testing.assert_allclose(smooth[~grazed, COLOURS], splats[~grazed, COLOURS], atol=0.02)
    np.testing.assert_array_equal(smooth[:, :COLOUR], splats[:, :COLOUR])
    # between the skin's colour and the spots'
    assert 0.1 < smooth[grazed, COLOUR].min() < smooth[:, COLOUR].max() <= 0.71


def test_what_a_rim_shows_well_stays_since_the_front_is_made_of_it(cheek):
    splats, pixels = cheek
    rim = np.full_like(pixels, 0.3)
    assert roughness(smoothed(splats, rim), rim > 0) > 0.8 * roughness(splats, rim > 0)


@pytest.mark.parametrize("what", ["hair", "skin that hair covers", "sides that are guessed"])
def test_nothing_but_seen_skin_changes(cheek, what):
    splats, pixels = cheek
    smooth = smoothed(
        splats,
        np.zeros_like(pixels) if what == "sides that are guessed" else pixels,
        SCALP if what == "hair" else FACE,
        np.full(len(splats), what == "skin that hair covers"),
    )
    np.testing.assert_array_equal(smooth, splats)


def test_hair_that_lies_on_a_cheek_keeps_its_colour(cheek):
    splats, _ = cheek
    splats[:, COLOURS] = np.where(splats[:, :1] < 0.02, 0.7, 0.1)
    smooth = smoothed(splats, np.full(len(splats), SLIVER, np.float32))
    far = np.abs(splats[:, 0] - 0.02) > 0.01
    assert smooth[far & (splats[:, 0] < 0.02), COLOUR].min() > 0.5
    assert smooth[far & (splats[:, 0] > 0.02), COLOUR].max() < 0.3
