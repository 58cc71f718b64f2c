"""Clicks and lips whose moments are known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.lipsync.offsets import Shown, Sound, clicks_heard, lateness
from benchmarks.lipsync.talker import AUDIO_HZ, CLICK_S, OPEN_S, PERIOD_S, is_open, sound

BLOCK = 128
LASTS_S = 12.0
FIRST_S = 0.3


def heard(later_s: float) -> Sound:
    samples = np.abs(sound(0, round(LASTS_S * AUDIO_HZ))) / 32767.0
    peaks = samples[: len(samples) // BLOCK * BLOCK].reshape(-1, BLOCK).max(axis=1)
    return Sound(FIRST_S + later_s + np.arange(len(peaks)) * BLOCK / AUDIO_HZ, peaks)


def seen(later_s: float, noise: float = 4.0) -> Shown:
    """Lips that part in the middle of 30 pictures a second, before a camera's noise."""
    rng, times_s = np.random.default_rng(0), np.arange(0.0, LASTS_S, 1.0 / 30.0)
    pictures = 100.0 + noise * rng.standard_normal((len(times_s), 16, 16))
    for picture, time_s in zip(pictures, times_s, strict=True):
        picture[6:9, 4:12] -= 60.0 * is_open(time_s - FIRST_S - later_s)
    return Shown(times_s, pictures.astype(np.float32))


@pytest.mark.parametrize("late_ms", [-120.0, 0.0, 75.0, 200.0])
def test_how_much_later_lips_are_seen_is_found_within_a_picture(late_ms):
    figures = lateness(heard(0.1), seen(0.1 + 1e-3 * late_ms), FIRST_S)
    assert figures["openings"] >= 8
    assert figures["missed"] == 0
    # a picture shows lips half a frame after they parted, on the mean
    assert figures["lips_after_voice_p50_ms"] == pytest.approx(late_ms + 16.0, abs=17.0)
    assert figures["voice_age_p50_ms"] == pytest.approx(100.0, abs=4.0)


def test_lips_that_never_part_are_missed_and_not_guessed():
    still = seen(0.0, noise=0.0)
    still.pictures[len(still.pictures) // 2 :] = still.pictures[0]
    figures = lateness(heard(0.0), still)
    assert figures["missed"] > 2
    assert figures["openings"] > 2
    assert abs(figures["lips_after_voice_p50_ms"]) < 40


def test_each_click_is_heard_once():
    found = clicks_heard(heard(0.0))
    assert len(found) == int(LASTS_S / PERIOD_S) + 1
    assert np.diff(found) == pytest.approx(PERIOD_S, abs=2 * BLOCK / AUDIO_HZ)
    assert CLICK_S < OPEN_S < PERIOD_S
