"""Poses are as far off as claimed, and cameras and bodies in the way that is meant."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stability.poses import (
    body_scale,
    focal_length,
    joint_mm,
    noisy,
    pose_noise,
    root_drift,
    rotation_deg,
)
from scene.motion import Motion
from tests.benchmarks.stability.people import subject

RNG = np.random.default_rng


def test_noise_is_as_large_as_claimed():
    motion = subject(40).material.true_motion
    # the length of three independent deviations is sqrt(8 / pi) = 1.6 times one
    assert rotation_deg(noisy(motion, 2.0, RNG(0), lasting=False), motion) == pytest.approx(
        3.19, rel=0.05
    )


def test_noise_that_lasts_changes_little_from_frame_to_frame():
    motion = subject(40).material.true_motion
    steps = [
        np.abs(np.diff(noisy(motion, 2.0, RNG(0), lasting=lasting).joint_angles, axis=0)).mean()
        for lasting in (True, False)
    ]
    assert steps[0] < 0.4 * steps[1]
    assert rotation_deg(noisy(motion, 2.0, RNG(0), lasting=True), motion) > 2.0


def test_more_noise_is_more_of_the_same():
    somebody = subject()
    off = [
        rotation_deg(_motion(pose_noise(somebody, deg, RNG(3))), somebody.material.true_motion)
        for deg in (1.0, 2.0)
    ]
    assert off[1] == pytest.approx(2.0 * off[0], rel=0.01)


def test_a_root_that_drifts_ends_where_it_is_said_to():
    somebody = subject()
    drifted = _motion(root_drift(somebody, 0.2, RNG(0)))
    way = np.linalg.norm(
        drifted.root_translation - somebody.material.true_motion.root_translation, axis=1
    )
    assert way[0] == 0.0
    assert way[-1] == pytest.approx(0.2)


def test_a_wrong_focal_length_leaves_the_pelvis_where_it_is_seen():
    somebody = subject()
    rest = somebody.material.body.skeleton.rest_joints[0]
    for before, after in zip(
        somebody.material.train, focal_length(somebody, 40.0, RNG(0)).train, strict=True
    ):
        seen, depth = before.camera.project(rest + before.pose.root_translation)
        again, farther = after.camera.project(rest + after.pose.root_translation)
        np.testing.assert_allclose(again, seen, atol=1e-6)
        assert farther == pytest.approx(1.4 * depth)


def test_a_body_that_is_too_large_has_its_pelvis_in_place():
    somebody = subject()
    large = body_scale(somebody, 10.0, RNG(0))
    skeleton = large.body.skeleton
    for before, after in zip(somebody.material.judged, large.judged, strict=True):
        pelvis = [
            body.rest_joints[0] + frame.pose.root_translation
            for body, frame in ((somebody.material.body.skeleton, before), (skeleton, after))
        ]
        np.testing.assert_allclose(pelvis[0], pelvis[1])
    truth = somebody.material.true_motion
    assert joint_mm(_motion(large), skeleton, truth, somebody.material.body.skeleton) > 10.0


def _motion(material) -> Motion:
    return Motion.from_poses([frame.pose for frame in material.train])
