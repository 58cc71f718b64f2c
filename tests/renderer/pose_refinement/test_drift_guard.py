"""Held-out frames tell when refined poses have led the model astray."""

from __future__ import annotations

import numpy as np

from renderer.pose_refinement.drift_guard import DriftGuard


def test_few_frames_of_the_whole_clip_are_held_out():
    guard = DriftGuard(100, active=True)
    assert len(guard.held_out) == 5
    assert set(guard.held_out) | set(guard.trained.tolist()) == set(range(100))
    assert not set(guard.held_out) & set(guard.trained.tolist())
    assert np.diff(guard.held_out).max() <= 20
    assert guard.held_out[0] < 20 <= 80 <= guard.held_out[-1]


def test_short_clips_and_poses_that_are_not_given_lose_no_frame():
    assert DriftGuard(10, active=True).held_out == ()
    assert not DriftGuard(10, active=True).has_drifted(lambda _: 1.0)
    assert DriftGuard(400, active=False).held_out == ()


def test_an_error_that_grows_is_drift_and_one_that_scatters_is_not():
    guard = DriftGuard(100, active=True)
    assert not guard.has_drifted(lambda _: 0.5)
    assert not guard.has_drifted(lambda frame: 0.3 + 0.001 * frame)
    assert not guard.has_drifted(lambda _: 0.365)
    assert guard.has_drifted(lambda _: 0.45)


def test_the_least_error_survives_a_restart():
    guard, restarted = DriftGuard(100, active=True), DriftGuard(100, active=True)
    guard.has_drifted(lambda _: 0.1)
    restarted.restore(guard.state())
    assert restarted.has_drifted(lambda _: 0.2)
