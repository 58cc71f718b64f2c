"""The viewer's file: small, the same picture, any beginning of it a model."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest

from renderer.relighting.shading import albedo_of, normals_of
from renderer.splats.files.importance import importance_order
from renderer.splats.files.viewer_file import RECORD, encode, write_viewer_file
from renderer.splats.layout import LOG_SCALE, POSITION
from renderer.splats.unseen import capture_weight
from scene.colour import to_srgb
from scene.expression import BLEND_SHAPE_COUNT
from tests.renderer.splats.viewer_file import HEAD_BYTES, decode, demo_model, pictures, psnr_on_body
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


def test_twenty_thousand_splats_fit_six_times_into_what_a_client_may_be_sent(demo, encoded):
    assert RECORD.itemsize == 32
    head, moved = HEAD_BYTES + 14 * 24 + 8 * BLEND_SHAPE_COUNT, len(demo.expression_splats)
    offsets = len(encoded) - head - 32 * len(demo)
    assert offsets % 7 == 0
    assert moved < offsets // 7 < 2 * moved  # most are moved by one or two expressions
    assert head + (len(encoded) - head) * 20_000 / len(demo) < 5e6 / 6.5


def test_the_picture_does_not_suffer(demo, encoded, truth):
    """59.3 dB on the body, over 20 more than any model is off its person."""
    assert psnr_on_body(pictures(decode(encoded, demo)), truth) > 53.0


@pytest.mark.parametrize(("share", "least_db"), [(0.75, 31.0), (0.5, 25.5), (0.25, 21.0)])
def test_any_beginning_is_a_model(demo, encoded, truth, share, least_db):
    part = pictures(decode(encoded, demo, share))
    assert psnr_on_body(part, truth) > least_db
    # no holes: what the whole covers, the part covers
    whole = truth[..., 3] > 0.95
    assert part[..., 3][whole].mean() > 0.9


def test_importance_beats_chance(demo, truth):
    order = importance_order(demo)
    assert sorted(order) == list(range(len(demo)))
    rows = order[: len(order) // 2], np.random.default_rng(1).permutation(order)[: len(order) // 2]
    figures = []
    for kept in rows:
        half = decode(encode(demo), demo, 0.5)
        half.parameters[:] = demo.parameters[kept]
        half.parameters[:, LOG_SCALE : LOG_SCALE + 3] += 0.25 * np.log(2.0)
        half.joints[:], half.weights[:] = demo.joints[kept], demo.weights[kept]
        figures.append(psnr_on_body(pictures(half), truth))
    assert figures[0] > 27.0
    assert figures[0] > figures[1] + 0.4


def records(encoded: bytes) -> np.ndarray:
    count = struct.unpack_from("<I", encoded, 8)[0]
    return np.frombuffer(encoded, RECORD, count, offset=HEAD_BYTES + 14 * 24)


def test_what_was_not_filmed_is_told(demo):
    rest = demo.parameters[:, POSITION : POSITION + 3]
    seated = replace(demo, seen=demo.seen & (rest[:, 1] > 0.9))
    stored = records(encode(seated))["capture_weight"]
    wanted = np.rint(255 * capture_weight(rest, seated.seen)[importance_order(seated)])
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
    order, back = importance_order(demo), decode(encoded, demo)
    assert back.albedo is not None
    wanted = to_srgb(albedo_of(demo))[order]
    np.testing.assert_allclose(to_srgb(back.albedo), wanted, atol=0.5 / 255 + 1e-4)
    normals = normals_of(demo)[order]  # kept in half floats, so hardly unit length
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    turned = (back.normals * normals).sum(axis=1)
    assert np.degrees(np.arccos(turned.clip(-1, 1))).max() < 0.6
