"""Several recordings in one zip are one clip."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from capture.errors import CaptureStopped, UnreadableClip
from capture.overlay import write_video
from capture.sources.clips import read_clip
from capture.sources.pieces import holds_pieces, read_pieces
from tests.capture.people import encoded


def _recording(path: Path, shades: list[int], size: tuple[int, int] = (32, 48)) -> Path:
    write_video([np.full((*size, 3), shade, np.uint8) for shade in shades], path, 10)
    return path


def _zip(path: Path, *recordings: Path) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for recording in recordings:
            archive.write(recording, recording.name)
    return path


@pytest.fixture
def three(tmp_path: Path) -> Path:
    """Recordings of 4, 8 and 4 frames, stored in another order than their names'."""
    made = [
        _recording(tmp_path / f"{name}.mp4", shades)
        for name, shades in (
            ("10-last", [200] * 4),
            ("1-first", [40] * 4),
            ("2-second", list(range(80, 160, 10))),
        )
    ]
    return _zip(tmp_path / "me.zip", *made)


def _shades(clip) -> list[int]:
    return [int(image.mean()) for image in clip.images]


def test_recordings_follow_each_other_by_their_names(three):
    clip = read_clip(three, 100)
    assert _shades(clip) == pytest.approx([40] * 4 + list(range(80, 160, 10)) + [200] * 4, abs=4)
    assert (clip.source_size, clip.source_frames, clip.recordings) == ((48, 32), 16, 3)


def test_between_two_recordings_time_passes(three):
    steps = np.diff(read_clip(three, 100).times_s)
    assert steps[[3, 11]] == pytest.approx([1.0, 1.0])
    assert np.delete(steps, [3, 11]) == pytest.approx(0.1, abs=1e-3)


def test_frames_are_spread_evenly_over_all_of_them(three):
    clip = read_clip(three, 8)
    counts = [sum(abs(shade - of) < 5 for shade in _shades(clip)) for of in (40, 200)]
    assert len(clip.images) == 8
    assert counts == [2, 2]


def test_a_recording_too_short_to_be_sampled_is_left_out(tmp_path):
    path = _zip(
        tmp_path / "me.zip",
        _recording(tmp_path / "1.mp4", [40] * 30),
        _recording(tmp_path / "2.mp4", [120]),
        _recording(tmp_path / "3.mp4", [200] * 30),
    )
    assert 120 not in np.round(_shades(read_pieces(path, max_frames=8)), -1)


def test_recordings_of_another_size_are_refused(tmp_path):
    first = _recording(tmp_path / "1.mp4", [40] * 8)
    path = _zip(tmp_path / "me.zip", first, _recording(tmp_path / "2.mp4", [90] * 8, (48, 32)))
    with pytest.raises(UnreadableClip, match=r"must be 48 x 32 as the first; got 32 x 48 in numb"):
        read_clip(path, 100)


def test_a_recording_that_is_none_is_named(tmp_path):
    (tmp_path / "2.mp4").write_bytes(b"hello there")
    path = _zip(tmp_path / "me.zip", _recording(tmp_path / "1.mp4", [40] * 8), tmp_path / "2.mp4")
    with pytest.raises(UnreadableClip, match=r"2\.mp4 must be a video"):
        read_clip(path, 100)


def test_a_zip_with_pictures_is_a_zip_of_frames(tmp_path):
    (tmp_path / "1.png").write_bytes(encoded(np.zeros((8, 8, 3), np.uint8)))
    recording = _recording(tmp_path / "1.mp4", [40] * 8)
    assert holds_pieces(_zip(tmp_path / "videos.zip", recording))
    assert not holds_pieces(_zip(tmp_path / "both.zip", recording, tmp_path / "1.png"))
    assert not holds_pieces(_zip(tmp_path / "none.zip"))


def test_progress_rises_over_all_of_them_and_a_stop_is_heard(three):
    shares: list[float] = []
    read_pieces(three, on_progress=shares.append)
    assert shares == sorted(shares)
    assert len(shares) == 16
    assert shares[-1] == pytest.approx(1.0)
    with pytest.raises(CaptureStopped):
        read_pieces(three, should_stop=lambda: True)
