"""The time of reading is measured on as many frames as it says."""

from __future__ import annotations

from benchmarks.foreign.reading import measure_reading


def test_more_frames_than_were_drawn_are_read_and_cut_to_the_person() -> None:
    found = measure_reading(frames=30, size=64)
    assert found["frames"] == 30
    assert found["seconds"] > 0.0
    whole_mib = 30 * 64 * 64 * 4 / 2**20
    assert 0.1 * whole_mib < found["kept_mib"] < whole_mib
