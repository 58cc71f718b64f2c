"""Hands before a chest hide it, hands away do not; parts of a picture are judged by themselves."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.covered_torso import (
    COVERED_SHARE,
    REST_SHARE,
    Covered,
    hands_away,
    hands_before_chest,
    part_lpips,
)
from capture.studio.lifelike.performer import make_lifelike_performer
from capture.studio.named_performers import LIFELIKE_PERFORMERS
from renderer.evaluation.lpips import PACKAGED_BACKBONE, Lpips
from scene.camera import orbit_camera
from tests.shared_data import shared_data


@pytest.fixture(scope="module")
def scene() -> Covered:
    assets = shared_data("human-assets")
    performer = make_lifelike_performer(LIFELIKE_PERFORMERS["moss"], assets)
    return Covered(performer, orbit_camera((0.0, 1.25, 0.0), 1.6, 0.0, 0.0, 96, 96, 0.6))


def test_hands_hide_a_part_of_the_torso_and_leave_another(scene):
    clip, away = hands_before_chest(scene.performer.body.skeleton, 20), hands_away(4)
    hidden = scene.hidden_shares(clip)
    triangle = scene.triangles(away.pose(0))
    shares = hidden[triangle[triangle >= 0]]
    assert (shares >= COVERED_SHARE).mean() > 0.1
    assert (shares <= REST_SHARE).mean() > 0.3
    # in none of the test's poses is a hand before the trunk
    assert scene.hidden_shares(away)[triangle[40:70, 40:56]].max() == 0.0


def test_both_wrists_come_before_the_chest(scene):
    skeleton = scene.performer.body.skeleton
    clip = hands_before_chest(skeleton, 12)
    placed = skeleton.joint_transforms(clip.joint_angles, clip.root_translation)[:, :, :3, 3]
    spine, wrists = (
        skeleton.names.index("spine3"),
        [skeleton.names.index(f"{side}_wrist") for side in ("left", "right")],
    )
    off = np.linalg.norm(placed[:, wrists] - placed[:, [spine]], axis=2)
    assert off.max() < 0.35
    assert np.ptp(placed[:, wrists], axis=0).max() > 0.15


def test_only_the_part_counts_and_however_large_it_is():
    rng, lpips = np.random.default_rng(0), Lpips(PACKAGED_BACKBONE)
    truth = rng.uniform(size=(128, 128, 3)).astype(np.float32)
    made = truth.copy()
    made[:, :64] = rng.uniform(size=(128, 64, 3))
    left, right = np.zeros((128, 128), bool), np.zeros((128, 128), bool)
    left[:, :60], right[:, 68:] = True, True
    assert part_lpips(lpips, made, truth, right) == 0.0
    whole = part_lpips(lpips, made, truth, left)
    left[64:] = False
    assert part_lpips(lpips, made, truth, left) == pytest.approx(whole, rel=0.25)
