"""What a model of a capture is judged by: the clean truth, in the captured world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.stability.captures import by_the_truth
from benchmarks.stability.judge import flicker
from benchmarks.stability.pictures import CROPS
from scene.sequence import NOVEL_VIEW, Sequence
from tests.renderer.studio import make_model, make_sequence


def truth() -> Sequence:
    clip = make_sequence(frames=12)
    return replace(clip, test={NOVEL_VIEW: clip.train})


def test_flicker_is_told_by_clean_frames_that_follow_one_another():
    material = by_the_truth(truth(), truth(), 1.0, CROPS[0])
    assert len(material.successive) == 6
    for early, late in material.successive:
        assert late.pose.time_s - early.pose.time_s == pytest.approx(0.1)
    # of the model that drew the truth
    assert flicker(make_model(), material.successive) == pytest.approx(1.0, abs=0.05)


def test_a_captured_world_of_half_the_size_shows_the_same_pictures():
    whole, small = (by_the_truth(truth(), truth(), scale, CROPS[0]) for scale in (1.0, 2.0))
    for one, other in zip(whole.successive, small.successive, strict=True):
        for frame, scaled in zip(one, other, strict=True):
            np.testing.assert_array_equal(scaled.image, frame.image)
            distance, half = (
                np.linalg.norm(seen.camera.world_to_camera[:, 3]) for seen in (frame, scaled)
            )
            assert half == pytest.approx(0.5 * distance)


def test_whatever_is_judged_ends_where_the_footage_does():
    whole, ended = (by_the_truth(truth(), truth(), 1.0, part) for part in (CROPS[0], "waist"))
    for part, of_all in zip(ended.judged, whole.judged, strict=True):
        assert part.camera.height < of_all.camera.height
    for pair in ended.successive:
        assert all(frame.mask.shape[0] == frame.camera.height < 48 for frame in pair)
