"""Finer splats on sides that no frame shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from renderer.splats.layout import COLOUR, LOG_SCALE, OPACITY, POSITION
from renderer.splats.settings import SplatSettings
from renderer.splats.training.finer_sides import finer_layer, wide_on_unseen_sides
from renderer.splats.training.surface_kinds import KINDS
from renderer.splats.training.trainer import SplatTrainer
from renderer.splats.unseen import capture_weight
from scene.sequence import Sequence
from tests.renderer.studio import make_sequence

SETTINGS = SplatSettings(count=1500, most=1500)


def one_sided() -> Sequence:
    """Frames of one side alone."""
    whole = make_sequence(frames=24)
    return whole.part([0, 1, 23])


def trained(trainer: SplatTrainer, fractions: np.ndarray) -> None:
    for fraction in fractions:
        trainer.before_step(float(fraction))
        trainer.step(float(fraction))


def widest_m(parameters: np.ndarray) -> np.ndarray:
    return np.exp(parameters[:, LOG_SCALE : LOG_SCALE + 3].max(axis=1))


def test_unseen_sides_get_finer_splats_and_seen_ones_keep_theirs():
    trainer = SplatTrainer(one_sided(), SETTINGS, 0)
    trained(trainer, np.arange(0.0, 1.0, 0.02))
    model = trainer.finish({})
    assert len(model) == model.metrics["splats"] > 1500
    rest = model.parameters[:, POSITION : POSITION + 3]
    unseen = ~model.seen & (capture_weight(rest, model.seen) > 0.0)
    assert unseen.sum() > 1000
    assert np.median(widest_m(model.parameters[unseen])) < 0.009
    assert np.median(widest_m(model.parameters[model.seen])) > 0.009


def test_the_far_side_of_a_trunk_is_closed_and_stays_so():
    trainer = SplatTrainer(one_sided(), SETTINGS, 0)
    trained(trainer, np.arange(0.0, 0.8, 0.02))
    trainer.splats.parameters[:, OPACITY] = -1.0
    trainer.before_step(0.8)
    closed = trainer.splats.parameters.copy()
    trunk = trainer.splats.kinds == KINDS.index("trunk")
    filled = closed[:, OPACITY] >= 2.0
    assert filled[trunk].sum() > 100
    trained(trainer, np.arange(0.82, 1.0, 0.02))
    np.testing.assert_array_equal(trainer.splats.parameters[filled], closed[filled])
    assert (trainer.splats.parameters[~filled] != closed[~filled]).any()


def test_a_layer_lies_evenly_and_has_the_colours_of_what_it_replaces():
    body = one_sided().body
    layer = finer_layer(body, 0.2)
    assert len(layer.parameters) > 5000
    np.testing.assert_array_equal(layer.parameters, finer_layer(body, 0.2).parameters)
    trainer = SplatTrainer(one_sided(), SETTINGS, 0)
    trained(trainer, np.arange(0.0, 0.8, 0.02))
    trainer.before_step(0.8)
    colours = trainer.finish({}).parameters[1500:, COLOUR : COLOUR + 3]
    # the box has three colours, and guesses are medians of them
    assert np.isfinite(colours).all()
    assert colours.min() > -0.1
    assert colours.max() < 1.1


def test_narrow_seen_and_never_filmed_splats_stay():
    parameters = np.zeros((4, 14), np.float32)
    parameters[:, LOG_SCALE : LOG_SCALE + 3] = np.log(0.012)
    parameters[1, LOG_SCALE : LOG_SCALE + 3] = np.log(0.004)
    parameters[3, POSITION] = 2.0
    seen = np.array([True, False, False, False])
    np.testing.assert_array_equal(
        wide_on_unseen_sides(parameters, seen), [False, False, True, False]
    )


def test_a_checkpoint_goes_on_with_finer_sides():
    trainer, another = (SplatTrainer(one_sided(), SETTINGS, 0) for _ in range(2))
    trained(trainer, np.arange(0.0, 0.9, 0.1))
    another.restore(trainer.state())
    assert len(another.splats) == len(trainer.splats) > 1500
    assert another.learn(0.9) == trainer.learn(0.9)


def test_a_body_without_a_surface_is_left_as_it_is():
    sequence = one_sided()
    joints_only = replace(
        sequence,
        body=replace(sequence.body, rest_vertices=None, faces=None, blend_weights=None),
    )
    trainer = SplatTrainer(joints_only, SETTINGS, 0)
    trained(trainer, np.arange(0.0, 0.9, 0.1))
    assert len(trainer.splats) == 1500
