"""The viewer's file: small, the same picture, any beginning of it a model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.relighting.shading import albedo_of, normals_of
from renderer.splats.files.viewer_file import RECORD, SPLIT, encode, write_viewer_file
from renderer.splats.layout import POSITION
from renderer.splats.levels.tree import FEWEST, level_tree
from renderer.splats.unseen import capture_weight
from scene.colour import to_srgb
from scene.expression import BLEND_SHAPE_COUNT
from tests.renderer.splats.viewer_file import (
    HEAD_BYTES,
    decode,
    demo_model,
    pictures,
    psnr_on_body,
    read_levels,
)
from tests.renderer.studio import make_model


@pytest.fixture(scope="module")
def demo():
    return demo_model()


@pytest.fixture(scope="module")
def encoded(demo) -> bytes:
    return encode(demo)


@pytest.fixture(scope="module")
def truth(demo) -> np.ndarray:
    return pictures(demo)


def test_twenty_thousand_splats_fit_three_times_into_what_a_client_may_be_sent(demo, encoded):
    assert (RECORD.itemsize, SPLIT.itemsize) == (32, 68)
    head = HEAD_BYTES + 14 * 24 + 8 * BLEND_SHAPE_COUNT
    records, moved = len(level_tree(demo).nodes), len(level_tree(demo).nodes.expression_splats)
    offsets = len(encoded) - head - 32 * records - 4 * (len(demo) - FEWEST)
    assert offsets % 7 == 0
    assert moved < offsets // 7 < 2 * moved  # most are moved by one or two expressions
    assert head + (len(encoded) - head) * 20_000 / len(demo) < 5e6 / 3


def test_the_first_fifty_kilobytes_hold_the_coarsest_level(encoded):
    assert HEAD_BYTES + 14 * 24 + 32 * FEWEST < 50_000


def test_the_picture_does_not_suffer(demo, encoded, truth):
    """59.3 dB on the body, over 20 more than any model is off its person."""
    assert psnr_on_body(pictures(decode(encoded, demo)), truth) > 53.0


@pytest.mark.parametrize(("share", "least_db"), [(0.75, 31.0), (0.5, 27.0), (0.25, 23.0)])
def test_any_beginning_is_a_model(demo, encoded, truth, share, least_db):
    part = pictures(decode(encoded, demo, share))
    assert psnr_on_body(part, truth) > least_db
    # no holes: what the whole covers, the part covers
    whole = truth[..., 3] > 0.95
    assert part[..., 3][whole].mean() > 0.9


def records(encoded: bytes) -> np.ndarray:
    return np.ascontiguousarray(read_levels(encoded)[0]).view(RECORD)[:, 0]


def test_what_was_not_filmed_is_told(demo):
    rest = demo.parameters[:, POSITION : POSITION + 3]
    seated = replace(demo, seen=demo.seen & (rest[:, 1] > 0.9))
    stored = records(encode(seated))["capture_weight"]
    nodes = level_tree(seated).nodes
    wanted = np.rint(255 * capture_weight(nodes.parameters[:, POSITION : POSITION + 3], nodes.seen))
    np.testing.assert_array_equal(stored, wanted)
    assert (stored == 0).any()


def test_weights_sum_to_one_exactly(encoded):
    stored = records(encoded)["weights"]
    assert (stored.sum(axis=1, dtype=int) == 255).all()


def test_the_same_model_gives_the_same_file(tmp_path):
    for name in ("a", "b"):
        write_viewer_file(make_model(80), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b"]
    back = decode((tmp_path / "a").read_bytes(), make_model(80))
    assert back.skeleton.parents == make_model().skeleton.parents
    np.testing.assert_allclose(back.skeleton.rest_joints, make_model().skeleton.rest_joints, 1e-6)


def test_the_light_of_the_clip_is_told_where_it_is_known(demo):
    light = np.random.default_rng(0).normal(1.0, 0.5, (9, 3)).astype(np.float32)
    back = decode(encode(replace(demo, light=light)), demo)
    assert back.light is not None
    np.testing.assert_array_equal(back.light, light)
    assert decode(encode(replace(demo, light=None)), demo).light is None


def test_what_light_falls_on_is_told(demo, encoded):
    """The file's own albedo and normals; of a model that knows none, those that the server uses."""
    finest, back = level_tree(demo).level(len(demo)), decode(encoded, demo)
    assert back.albedo is not None
    wanted = to_srgb(albedo_of(finest))
    np.testing.assert_allclose(to_srgb(back.albedo), wanted, atol=0.5 / 255 + 1e-4)
    normals = normals_of(finest)  # kept in half floats, so hardly unit length
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    turned = (back.normals * normals).sum(axis=1)
    assert np.degrees(np.arccos(turned.clip(-1, 1))).max() < 0.6
