"""The benchmark of expressions: what it hides is hidden, and its crops show face and hands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.expressions import (
    FACE,
    HANDS,
    LIDS,
    SEEDS,
    TOGETHER,
    Part,
    RenderedExpression,
    changed,
    hiding,
    together,
    unseen_views,
    worth,
)
from capture.studio.performer import make_performer, render_performer
from scene import EXPRESSION_NAMES
from scene.expression import GAZE
from tests.renderer.studio import make_sequence


@pytest.fixture(scope="module", params=[FACE, HANDS], ids=["face", "hands"])
def filmed(request) -> tuple[Part, list[RenderedExpression]]:
    performer = make_performer(SEEDS[0], expressive=True)
    return request.param, unseen_views(request.param, performer, SEEDS[0])


def test_crops_show_skin(filmed):
    part, shots = filmed
    skin, shown = make_performer(SEEDS[0]).outfit.skin, []
    for shot in shots:
        for crop in shot.crops[part.name]:
            patch = shot.image[crop]
            assert min(patch.shape[:2]) > 15
            shown.append((np.abs(patch - skin).max(axis=2) < 0.15).mean())
    assert np.median(shown) > (0.4 if part is FACE else 0.05)


def test_an_eye_that_shuts_changes_its_crop():
    performer, pictures = make_performer(SEEDS[0], expressive=True), {}
    shot = unseen_views(FACE, performer, SEEDS[0])[3]  # both eyes show
    for lid in (*LIDS, None):
        shown = [float(name == lid) for name in EXPRESSION_NAMES]
        pose = replace(shot.pose, expression=np.array(shown))
        pictures[lid] = render_performer(performer, pose, shot.camera, "plain")[0]
    left, right = LIDS
    (crop,) = shot.crops[left]
    changed = {lid: np.abs(pictures[lid] - pictures[None])[crop].mean() for lid in LIDS}
    assert changed[left] > 0.01
    assert changed[right] < 0.2 * changed[left]


def test_test_pictures_differ_by_expression(filmed):
    shown = np.array([shot.pose.expression for shot in filmed[1]])
    assert (np.ptp(np.delete(shown, GAZE, axis=1), axis=0) > 0.7).all()
    assert (np.ptp(shown[:, GAZE], axis=0) > 0.5).all()


def test_what_is_left_out_is_gone():
    clip = make_sequence(frames=4)
    moving = changed(clip, hiding(()))
    assert not moving.motion.expressions.any()  # the box shows nothing
    clip.motion.expressions[:] = 0.5
    left = changed(clip, hiding(("smile",))).motion.expressions
    assert not left[:, EXPRESSION_NAMES.index("smile")].any()
    assert (np.delete(left, EXPRESSION_NAMES.index("smile"), axis=1) == 0.5).all()


def test_fingers_together_bend_by_their_mean():
    apart = np.arange(34.0).reshape(2, 17) / 34.0
    bent = together(apart)
    np.testing.assert_array_equal(bent[:, :7], apart[:, :7])
    np.testing.assert_allclose(bent[:, 7:12], np.repeat(apart[:, 9:10], 5, axis=1))
    np.testing.assert_allclose(bent[1, 12:], [31.0 / 34.0] * 5)
    assert apart[0, 7] == 7.0 / 34.0


def test_worth_is_the_mean_gain_and_its_spread():
    def row(part, best: float) -> dict:
        db = {"off": 20.0, "off, denser": 20.5, "even": 22.0, "on": best}
        db |= {f"without {n}": 21.0 for n in part.left_out} | {TOGETHER: 21.5}
        crops = {part.name, *(part.crop_of(n) for n in part.left_out)}
        return {"part": part.name, "db": {way: dict.fromkeys(crops, v) for way, v in db.items()}}

    made = worth([row(FACE, 23.0), row(FACE, 24.0), row(HANDS, 22.0)])
    assert made["face: both"] == {"gain_db": 3.5, "spread_db": 0.5}
    assert made["face: density alone"]["gain_db"] == 0.5
    assert made["smile"]["gain_db"] == 2.5
    assert made["left_hand_curl"] == {"gain_db": 1.0, "spread_db": 0.0}
    assert made["fingers apart"] == {"gain_db": 0.5, "spread_db": 0.0}
