"""Hands in training: noise goes, what neighbours share stays, and nothing else is touched."""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, PARAMETERS, POSITION, ROTATION
from renderer.splats.training.neighbours import mean_of_neighbours
from renderer.splats.training.smooth_hands import SmoothHands
from renderer.splats.training.surface_kinds import KINDS

COLOURS, PLACE = slice(COLOUR, COLOUR + 3), slice(POSITION, POSITION + 3)
SIDE = 20
COUNT = SIDE * SIDE
EVERY = np.ones(COUNT, bool)
ARMS = np.arange(COUNT) < COUNT // 4


def make_surface() -> np.ndarray:
    """A square of splats, 2 mm apart; the first quarter of its rows belongs to the arms."""
    rows, columns = np.divmod(np.arange(COUNT), SIDE)
    surface = np.zeros((COUNT, PARAMETERS), np.float32)
    surface[:, PLACE] = 0.002 * np.column_stack([columns, rows, np.zeros(COUNT)])
    surface[:, LOG_SCALE : LOG_SCALE + 3] = -6.0
    surface[:, ROTATION] = 1.0
    surface[:, COLOURS] = (0.7, 0.5, 0.4)
    surface[:, OPACITY] = 2.0
    return surface


def make_hands(surface: np.ndarray) -> SmoothHands:
    kinds = np.where(ARMS, KINDS.index("arms"), KINDS.index("hands"))
    return SmoothHands(kinds, mean_of_neighbours(surface[:, PLACE]))


def test_noise_goes_and_a_change_that_all_share_stays():
    surface = make_surface()
    hands, rng = make_hands(surface), np.random.default_rng(0)
    trained = surface.copy()
    trained[:, COLOURS] += rng.normal(0.0, 0.1, (COUNT, 3)).astype(np.float32)
    trained[:, PLACE] += np.array([0.01, 0.0, 0.03], np.float32)
    trained[:, PLACE] += rng.normal(0.0, 0.006, (COUNT, 3)).astype(np.float32)
    before = trained.copy()
    for _ in range(200):
        hands.pull(trained, surface, EVERY)
    hand = ~ARMS
    assert trained[hand, COLOURS].std(axis=0).max() < 0.25 * before[hand, COLOURS].std(axis=0).min()
    away = (trained - surface)[hand, PLACE]
    assert np.abs(away - away.mean(axis=0)).max() < 0.006
    np.testing.assert_allclose(away.mean(axis=0), (0.01, 0.0, 0.03), atol=0.001)


def test_sizes_turns_and_opacities_go_back_to_the_surface():
    surface = make_surface()
    trained = surface.copy()
    trained[:, LOG_SCALE : LOG_SCALE + 3] += np.array([1.5, -1.0, 0.5], np.float32)
    trained[:, ROTATION : ROTATION + 4] = (0.6, 0.8, 0.0, 0.0)
    trained[:, OPACITY] = -3.0
    hands = make_hands(surface)
    for _ in range(1200):
        hands.pull(trained, surface, EVERY)
    np.testing.assert_allclose(trained[~ARMS], surface[~ARMS], atol=0.02)


def test_only_splats_of_hands_that_moved_are_pulled():
    surface = make_surface()
    trained = surface + np.random.default_rng(1).normal(0.0, 0.02, surface.shape).astype(np.float32)
    before, moved = trained.copy(), EVERY.copy()
    moved[-50:] = False
    make_hands(surface).pull(trained, surface, moved)
    still = ARMS | ~moved
    np.testing.assert_array_equal(trained[still], before[still])
    assert (trained[~still] != before[~still]).any(axis=1).all()


def test_a_mark_that_frames_agree_on_stays_visible():
    surface = make_surface()
    hands, trained = make_hands(surface), surface.copy()
    mark = COUNT - SIDE // 2 - 5 * SIDE
    for _ in range(300):
        # Adam's step towards what all frames show, at the rate of a training's middle
        trained[mark, COLOURS] -= np.float32(0.01) * np.sign(trained[mark, COLOURS] - 0.1)
        hands.pull(trained, surface, EVERY)
    assert trained[mark, COLOURS].max() < 0.65 * surface[mark, COLOURS].max()


def test_a_body_without_hands_is_left_alone():
    surface = make_surface()
    kinds = np.full(COUNT, KINDS.index("trunk"))
    trained = surface + np.float32(0.1)
    before = trained.copy()
    SmoothHands(kinds, mean_of_neighbours(surface[:, PLACE])).pull(trained, surface, EVERY)
    np.testing.assert_array_equal(trained, before)
