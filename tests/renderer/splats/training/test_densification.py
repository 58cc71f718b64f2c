"""Coarse splats give way to finer ones where pictures differ from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.splats.layout import ALPHA, COLOUR, LOG_SCALE, MEAN_X, MEAN_Y, OPACITY, POSITION
from renderer.splats.rasteriser.workspace import Workspace
from renderer.splats.settings import SplatSettings
from renderer.splats.training.densification import Densification, splat_errors, to_split
from renderer.splats.training.initialisation import FirstSplats, first_splats
from renderer.splats.training.trainer import SplatTrainer
from tests.renderer.studio import make_sequence

SETTINGS = replace(SplatSettings(), count=400, most=400, densified_above=300)
FEW = replace(SETTINGS, densified_above=400)


def fine() -> FirstSplats:
    return first_splats(make_sequence(), SETTINGS, np.random.default_rng(0))


def planned() -> Densification:
    found = Densification.planned(fine(), None, SETTINGS)
    assert found is not None
    return found


def coarse_trainer() -> SplatTrainer:
    return SplatTrainer(make_sequence(), SETTINGS, 0)


def test_coarse_splats_cover_what_fine_ones_do():
    found = planned()
    coarse, all_of_them = found.coarse.parameters, found.fine.parameters
    assert len(coarse) == 100
    area = np.exp(2.0 * coarse[:, LOG_SCALE]).sum() / np.exp(2.0 * all_of_them[:, LOG_SCALE]).sum()
    assert area == pytest.approx(1.0, abs=0.05)


def test_few_splats_are_not_made_coarse():
    assert Densification.planned(fine(), None, FEW) is None


def test_an_earlier_model_is_made_finer_where_it_has_less_than_half_as_many():
    first = fine()
    few, many = (first.taken(np.arange(count)) for count in (150, 250))
    found = Densification.planned(first, few, SETTINGS)
    assert found is not None
    assert found.coarse is few
    assert Densification.planned(first, many, SETTINGS) is None


def test_only_splats_that_are_shown_and_right_stay():
    frames = [
        (np.array([0.1, 0.001, 0.0, 0.001]), np.array([1.0, 1.0, 0.0, 1.0])),
        (np.array([0.1, 0.001, 0.0, 0.001]), np.array([1.0, 1.0, 0.0, 0.0])),
    ]
    assert to_split(frames).tolist() == [True, False, True, False]


def test_the_error_of_a_splat_is_that_of_the_pixels_about_it():
    work = Workspace(2)
    work.projected[:, [MEAN_X, MEAN_Y]] = [[5.2, 6.4], [-3.0, 90.0]]
    work.projected[:, ALPHA] = 0.5
    picture, truth = np.zeros((20, 30, 4), np.float32), np.zeros((20, 30, 4), np.float32)
    picture[5:8, 4:7, :3] = 0.2
    error, _ = splat_errors(work, np.ones(2, np.float32), picture, truth)
    np.testing.assert_allclose(error, [0.2, 0.0], atol=1e-6)


def test_finer_splats_go_on_from_their_parents():
    found = planned()
    split = np.zeros(100, bool)
    split[:10] = True
    splats = found.splats(split)
    children = int(split[found.parents].sum())
    assert len(splats.parameters) == 90 + children
    trained = found.coarse.parameters.copy()
    off = 0.02 * found.coarse.normals
    trained[:, POSITION : POSITION + 3] += off
    trained[:, COLOUR] = np.arange(100) / 100.0
    trained[:, OPACITY] = 1.5
    parameters = found.parameters(split, trained, splats.parameters)
    np.testing.assert_array_equal(parameters[:90], trained[10:])
    parents = found.parents[split[found.parents]]
    np.testing.assert_array_equal(parameters[90:, COLOUR], trained[parents, COLOUR])
    raised = (
        parameters[90:, POSITION : POSITION + 3] - splats.parameters[90:, POSITION : POSITION + 3]
    )
    same_side = np.einsum("nx,nx->n", splats.normals[90:], found.coarse.normals[parents]) > 0.99
    along = np.einsum("nx,nx->n", raised, splats.normals[90:])
    # the insets of parent and child are the same, so on one flat side they are as far off it
    np.testing.assert_allclose(along[same_side], 0.02, atol=1e-4)


def test_training_goes_on_with_finer_splats_after_a_quarter():
    trainer = coarse_trainer()
    for _ in range(4):
        trainer.before_step(0.24)
        trainer.step(0.24)
    assert len(trainer.splats) == 100
    trainer.before_step(0.25)
    assert len(trainer.splats) > 100
    for _ in range(4):
        assert np.isfinite(trainer.step(0.5))
    assert len(trainer.finish({})) == len(trainer.splats)


def test_training_goes_back_to_coarse_splats_and_on_from_finer_ones():
    trainer = coarse_trainer()
    for _ in range(4):
        trainer.step(0.2)
    coarse = trainer.state()
    trainer.before_step(0.25)
    trainer.step(0.3)
    finer, count = trainer.state(), len(trainer.splats)
    losses = [trainer.step(0.3) for _ in range(3)]
    trainer.before_step(0.8)

    trainer.restore(coarse)
    assert len(trainer.splats) == 100
    assert np.isfinite(trainer.step(0.9))
    trainer.restore(coarse)
    trainer.before_step(0.25)
    assert len(trainer.splats) == count

    another = coarse_trainer()
    another.restore(finer)
    assert len(another.splats) == count
    assert [another.step(0.3) for _ in range(3)] == losses
