"""The noise that the benchmark of pose refinement adds is what it says."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.refinement import SHIFT_M, rotation_error_deg, with_noise
from scene import PoseTrust
from tests.renderer.studio import make_sequence


def test_noise_is_as_large_as_claimed_and_the_clip_counts_as_estimated():
    clip = make_sequence(frames=40)
    noisy = with_noise(clip, 2.0, lasting=False)
    # the length of three independent deviations is sqrt(8 / pi) = 1.6 times one
    assert rotation_error_deg(noisy.motion, clip.motion) == pytest.approx(3.19, rel=0.05)
    assert noisy.pose_trust is PoseTrust.ESTIMATED
    np.testing.assert_array_equal(noisy.motion.root_translation, clip.motion.root_translation)
    np.testing.assert_array_equal(noisy.train.pose(7).joint_angles, noisy.motion.joint_angles[7])


def test_noise_that_lasts_changes_little_from_frame_to_frame():
    clip = make_sequence(frames=40)
    wandering = with_noise(clip, 2.0, lasting=True).motion.root_translation
    assert 0.3 * SHIFT_M < wandering.std() < 2.0 * SHIFT_M
    assert np.abs(np.diff(wandering, axis=0)).mean() < 0.3 * wandering.std()
