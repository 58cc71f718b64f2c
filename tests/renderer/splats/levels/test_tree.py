"""Any number of splats is a whole model, and a small picture needs few."""

from __future__ import annotations

import numpy as np
import pytest

from capture.storage import open_sequence
from capture.studio import make_sequence
from renderer.evaluation.metrics import psnr
from renderer.splats.layout import COLOUR, POSITION
from renderer.splats.levels.tree import FEWEST, LevelTree, level_tree
from renderer.splats.model import SplatModel
from renderer.training import train
from scene.sequence import NOVEL_VIEW, Sequence, body_crop
from tests.renderer.clocks import ticking
from tests.renderer.splats.viewer_file import demo_model, pictures, psnr_on_body
from tests.renderer.studio import make_model


@pytest.fixture(scope="module")
def demo() -> SplatModel:
    return demo_model()


@pytest.fixture(scope="module")
def tree(demo) -> LevelTree:
    return level_tree(demo)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> Sequence:
    """A studio performer, whose truth is known from new sides."""
    folder = tmp_path_factory.mktemp("studio") / "clip"
    make_sequence(folder, frames=24, size=160, test_cameras=2, uniform=True)
    return open_sequence(folder)


@pytest.fixture(scope="module")
def trained(filmed) -> SplatModel:
    splats = train(filmed, preset="splats", iterations=400, clock=ticking(0.001)).splats
    assert splats is not None
    return splats


def psnr_at(model: SplatModel, filmed: Sequence, factor: int) -> float:
    """dB of the body's crop in new views, each side divided by `factor`."""
    found, source = [], filmed.test[NOVEL_VIEW]
    for index in range(0, len(source), 4):
        camera = source.camera(index)
        high, wide = camera.height // factor, camera.width // factor
        blocks = (high, factor, wide, factor, -1)
        truth = source.image(index).reshape(blocks).mean(axis=(1, 3))
        mask = source.mask(index).reshape(blocks).max(axis=(1, 3))[..., 0]
        made = model.render(camera.resized(wide, high), source.pose(index))[..., :3]
        crop = body_crop(mask)
        assert crop is not None
        found.append(psnr(made[crop], truth[crop].astype(np.float32)))
    return float(np.mean(found))


def test_every_number_is_a_whole_model(demo, tree):
    """Each of the model's splats is in it by itself, or in one that stands for several."""
    assert (len(tree), tree.fewest) == (len(demo), FEWEST)
    for count in (FEWEST, FEWEST + 1, 4000, len(demo) - 1, len(demo)):
        drawn = tree.drawn(count)
        assert drawn.sum() == count
        above = drawn.astype(int)
        for j, parent in enumerate(tree.split):
            first = tree.fewest + 2 * j
            above[first : first + 2] += above[parent]
        assert (above[tree.rows] == 1).all()


def test_the_next_number_splits_one_splat(tree):
    before, after = tree.drawn(5000), tree.drawn(5001)
    assert (before & ~after).sum() == 1
    assert (after & ~before).sum() == 2


def test_all_of_them_are_the_model(demo, tree):
    np.testing.assert_array_equal(tree.nodes.parameters[tree.rows], demo.parameters)
    finest = tree.level(len(demo))
    assert psnr_on_body(pictures(finest, 2), pictures(demo, 2)) > 50.0
    assert tree.clamped(3.0) == FEWEST
    assert tree.clamped(1e9) == len(demo)


@pytest.mark.parametrize(("factor", "share"), [(2, 0.5), (2, 0.25), (4, 0.15)])
def test_fewer_splats_in_a_smaller_picture_lose_at_most_half_a_decibel(
    filmed, trained, factor, share
):
    """Half at half the size; a quarter, too. Where they end is told apart better, if anything."""
    tree = level_tree(trained)
    few = tree.level(tree.clamped(share * len(tree)))
    assert psnr_at(few, filmed, factor) > psnr_at(trained, filmed, factor) - 0.5


def test_what_splats_are_given_spreads_to_those_that_stand_for_them(demo, tree):
    places = demo.parameters[:, POSITION : POSITION + 3]
    spread = tree.spread(places)
    np.testing.assert_array_equal(spread[tree.rows], places)
    np.testing.assert_allclose(spread, tree.nodes.parameters[:, POSITION : POSITION + 3], atol=1e-5)
    grey = np.full((len(demo), 3), 0.25, np.float32)
    np.testing.assert_allclose(tree.spread(grey), 0.25, atol=1e-6)


def test_faces_move_at_every_level(demo, tree):
    few = tree.level(FEWEST)
    moved = few.parameters[few.expression_splats, POSITION : POSITION + 3]
    assert len(moved) > 100
    head = demo.parameters[demo.expression_splats, POSITION : POSITION + 3]
    assert (moved.min(axis=0) >= head.min(axis=0) - 1e-4).all()
    assert np.abs(few.expression_offsets).max() > 0.3 * np.abs(demo.expression_offsets).max()


def test_few_splats_have_one_level():
    model = make_model(80)
    tree = level_tree(model)
    assert tree.fewest == len(tree) == len(tree.nodes) == 80
    assert tree.drawn(tree.clamped(10)).all()
    colours = tree.nodes.parameters[tree.rows, COLOUR : COLOUR + 3]
    np.testing.assert_array_equal(colours, model.parameters[:, COLOUR : COLOUR + 3])
    assert level_tree(model) is tree
