"""Any clip is recognised by what it is, not by what it is called."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from capture.errors import CaptureStopped, UnreadableClip
from capture.overlay import write_video
from capture.sources.clips import MIN_FRAMES, read_clip
from tests.capture.people import encoded

FRAMES = MIN_FRAMES + 4


def grey(index: int) -> np.ndarray:
    return np.full((32, 48, 3), 20 + 15 * index, np.uint8)


def write_folder(path: Path, frames: int = FRAMES) -> Path:
    path.mkdir()
    for index in range(frames):
        (path / f"{index:02d}.png").write_bytes(encoded(grey(index)))
    return path


def write_zip(path: Path, frames: int = FRAMES) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for index in range(frames):
            archive.writestr(f"{index:02d}.png", encoded(grey(index)))
    return path


def write_mp4(path: Path, frames: int = FRAMES) -> Path:
    write_video([grey(index) for index in range(frames)], path, 30)
    return path


@pytest.mark.parametrize(
    ("write", "name"),
    [
        (write_folder, "frames"),
        (write_folder, "frames.mp4"),
        (write_zip, "frames.zip"),
        (write_zip, "frames.mp4"),
        (write_zip, "upload"),
        (write_mp4, "clip.mp4"),
    ],
)
def test_a_clip_is_read_whatever_its_name(tmp_path, write, name):
    clip = read_clip(write(tmp_path / name), 100)
    shades = [int(image.mean()) for image in clip.images]
    assert shades == pytest.approx([20 + 15 * index for index in range(FRAMES)], abs=4)
    assert clip.times_s == pytest.approx(np.arange(FRAMES) / 30.0, abs=1e-3)


@pytest.mark.parametrize("write", [write_folder, write_zip, write_mp4])
def test_no_more_frames_are_read_than_asked_for_from_the_first_to_the_last(tmp_path, write):
    clip = read_clip(write(tmp_path / "clip.mp4"), MIN_FRAMES)
    assert len(clip.images) == MIN_FRAMES
    assert clip.source_frames == FRAMES
    ends = [int(clip.images[index].mean()) for index in (0, -1)]
    assert ends == pytest.approx([20, 20 + 15 * (FRAMES - 1)], abs=4)


@pytest.mark.parametrize("write", [write_folder, write_zip, write_mp4])
def test_only_a_window_of_each_frame_is_kept_where_asked(tmp_path, write):
    window = (slice(4, 24), slice(8, 18))
    clip = read_clip(write(tmp_path / "clip.mp4"), 100, window=window, max_side=10)
    assert {image.shape for image in clip.images} == {(10, 5, 3)}
    assert clip.source_size == (48, 32)


@pytest.mark.parametrize("write", [write_folder, write_zip, write_mp4])
def test_too_few_frames_are_refused_with_both_numbers(tmp_path, write):
    path = write(tmp_path / "short.mp4", MIN_FRAMES - 1)
    with pytest.raises(UnreadableClip, match="the clip must have at least 8 frames; got 7"):
        read_clip(path, 100)
    assert len(read_clip(write(tmp_path / "enough.mp4", MIN_FRAMES), 100).images) == MIN_FRAMES


@pytest.mark.parametrize("name", ["nowhere", "nowhere.mp4", "nowhere.zip"])
def test_a_clip_that_is_not_there_is_refused_by_its_name(tmp_path, name):
    with pytest.raises(UnreadableClip, match=name):
        read_clip(tmp_path / name, 100)


@pytest.mark.parametrize("write", [write_folder, write_zip, write_mp4])
def test_progress_rises_and_a_stop_is_heard(tmp_path, write):
    path, shares = write(tmp_path / "clip.mp4"), []
    read_clip(path, 100, shares.append)
    assert shares == sorted(shares)
    assert len(shares) == FRAMES
    assert 0.0 <= shares[0] < shares[-1] <= 1.0
    with pytest.raises(CaptureStopped):
        read_clip(path, 100, should_stop=lambda: True)
