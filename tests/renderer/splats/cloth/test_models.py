"""Models in loose clothes: they are stored, levelled, and sent to pages with the cloth still."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest

from renderer.model_files import load_model, save_model
from renderer.splats.cloth.hanging import NO_CLOTH, MotionPath
from renderer.splats.files.viewer_file import encode
from renderer.splats.layout import POSITION
from renderer.splats.levels.tree import level_tree
from scene import InvalidInput, Pose, orbit_camera
from tests.renderer.splats.cloth.wear import make_loose_model
from tests.renderer.studio import make_model

MODEL = make_loose_model()


def test_a_file_keeps_the_cloth_and_one_of_tight_clothes_has_none(tmp_path):
    save_model(MODEL, tmp_path / "loose.safetensors")
    again = load_model(tmp_path / "loose.safetensors").splats
    assert again is not None
    assert again.cloth is not None
    assert MODEL.cloth is not None
    np.testing.assert_array_equal(again.quads, MODEL.quads)
    for name, array in MODEL.cloth.tensors().items():
        np.testing.assert_array_equal(again.cloth.tensors()[name], array)
    camera = orbit_camera((0, 0.8, 0), 3.0, 0.4, 0.1, 64, 64)
    pictures = [model.render(camera, Pose.rest()) for model in (MODEL, again)]
    assert np.abs(pictures[0] - pictures[1]).max() < 0.02
    tight = make_model().tensors()
    assert not [name for name in tight if name.startswith("cloth") or name == "quads"]


def test_splats_lie_on_quads_that_the_cloth_has():
    beyond = MODEL.quads.copy()
    beyond[-1] = 500
    with pytest.raises(InvalidInput, match=r"quads must be from 0 to below 48; got 0 to 500"):
        replace(MODEL, quads=beyond)


def test_merged_splats_of_a_level_lie_on_cloth_or_on_the_body_alone():
    rng = np.random.default_rng(0)
    many = make_loose_model()
    rows = rng.permutation(np.repeat(np.arange(len(many)), 3))
    parameters = many.parameters[rows]
    parameters[:, POSITION] += rng.normal(scale=0.002, size=len(rows))
    many = replace(
        many,
        parameters=parameters,
        joints=many.joints[rows],
        weights=many.weights[rows],
        seen=many.seen[rows],
        quads=many.quads[rows],
    )
    tree = level_tree(many)
    assert len(tree.nodes) > len(many)
    np.testing.assert_array_equal(tree.nodes.quads[tree.rows], many.quads)
    first = tree.fewest + 2 * np.arange(len(tree.split))
    on = tree.nodes.quads != NO_CLOTH
    np.testing.assert_array_equal(on[tree.split], on[first])
    np.testing.assert_array_equal(on[tree.split], on[first + 1])
    level = tree.level(tree.fewest)
    assert level.cloth is many.cloth
    assert 0.1 < (level.quads != NO_CLOTH).mean() < 0.9


def test_a_page_gets_the_cloth_as_it_hangs_in_the_mean_of_the_clip():
    still = MODEL.with_still_cloth()
    assert still.cloth is None
    assert MODEL.cloth is not None
    path = MotionPath.of(MODEL.motion, MODEL.skeleton, MODEL.motion.times_s)
    fall = (path.hung(MODEL.cloth).mean(axis=0) - MODEL.cloth.rest)[:, 1].mean()
    on = MODEL.quads != NO_CLOTH
    moved = (still.parameters - MODEL.parameters)[:, POSITION + 1]
    assert abs(moved[on].mean() - fall) < 0.02
    np.testing.assert_array_equal(moved[~on], 0.0)
    lowest = struct.unpack_from("<3f", encode(MODEL), 12)
    nodes = level_tree(MODEL).nodes.with_still_cloth()
    np.testing.assert_allclose(lowest, nodes.parameters[:, :3].min(axis=0), atol=1e-6)
    assert lowest[0] != pytest.approx(float(level_tree(MODEL).nodes.parameters[:, 0].min()))
