"""Packets come late and in bursts; when they were said is known all the same."""

from __future__ import annotations

import numpy as np
import pytest

from services.recording.voice_times import VoiceTimes

STEP, STEP_MS = 960, 20


def test_bursts_leave_a_voice_in_time_and_wraps_are_no_jumps():
    rng, said, first = np.random.default_rng(0), VoiceTimes(), (1 << 32) - 20 * STEP
    late_ms = np.maximum(0.0, rng.exponential(40.0, 300) - 20.0)
    late_ms[0] = 35.0
    arrived_ms = np.maximum.accumulate(1000.0 + STEP_MS * np.arange(300) + late_ms)
    at_ms = [
        said.at_ms((first + STEP * number) % (1 << 32), moment)
        for number, moment in enumerate(arrived_ms)
    ]
    assert np.diff(at_ms[30:]) == pytest.approx(STEP_MS, abs=12)
    assert np.abs(np.array(at_ms[30:]) - (1000.0 + STEP_MS * np.arange(30, 300))).max() < 12.0
    assert (np.array(at_ms) <= arrived_ms).all()


def test_a_pause_without_packets_is_kept_and_another_stream_begins_when_it_comes():
    said = VoiceTimes()
    assert said.at_ms(5000, 100.0) == 100
    assert said.at_ms(5000 + 48 * 2000, 2130.0) == pytest.approx(2102, abs=1)
    # a new connection counts from another number
    assert said.at_ms(123, 4000.0) == 4000
    assert said.at_ms(123 + STEP, 4035.0) == pytest.approx(4020, abs=1)
    assert said.at_ms(123 + STEP - 48 * 60_000, 4100.0) == 4100
