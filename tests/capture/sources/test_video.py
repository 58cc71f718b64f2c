"""Videos: even samples in display orientation, and files that are none."""

from __future__ import annotations

import struct
from fractions import Fraction

import av
import numpy as np
import pytest

from capture.errors import CaptureStopped, UnreadableClip
from capture.overlay import write_video
from capture.sources.video import (
    evenly_spaced,
    increasing,
    played_frames,
    probe_video,
    read_video,
    shrink,
)


@pytest.fixture
def clip(tmp_path):
    path = tmp_path / "clip.mp4"
    images = [np.full((48, 64, 3), 8 * i, dtype=np.uint8) for i in range(30)]
    write_video(images, path, 30)
    return path


def test_probe_tells_size_frames_and_rate(clip):
    info = probe_video(clip)
    assert (info.width, info.height, info.frames) == (64, 48, 30)
    assert info.frames_per_second == pytest.approx(30.0)


def test_frames_are_spread_from_the_first_to_the_last(clip):
    read = read_video(clip, max_frames=4)
    greys = [float(image.mean()) for image in read.images]
    assert greys == pytest.approx([0, 80, 152, 232], abs=4)
    assert read.times_s == pytest.approx([0.0, 10 / 30, 19 / 30, 29 / 30], abs=1e-3)
    assert read.source_frames == 30


def test_a_short_clip_keeps_every_frame(clip):
    read = read_video(clip)
    assert len(read.images) == 30
    assert read.frames_per_second == pytest.approx(30.0)


def test_a_clip_plays_the_frames_that_reading_gives(clip):
    read, played = read_video(clip), list(played_frames(clip))
    assert [one.time_s for one in played] == pytest.approx(read.times_s.tolist())
    for one, image in zip(played, read.images, strict=True):
        assert (one.image() == image).all()
    assert max(played[0].image(16).shape) == 16


def test_large_frames_are_made_smaller(clip):
    read = read_video(clip, max_side=32)
    assert read.images[0].shape == (24, 32, 3)
    assert read.source_size == (64, 48)


def test_a_window_is_cut_before_frames_are_made_smaller(tmp_path):
    image = np.zeros((48, 64, 3), np.uint8)
    image[16:32, 32:64] = 200
    write_video([image] * 3, tmp_path / "clip.mp4", 30)
    read = read_video(tmp_path / "clip.mp4", max_side=16, window=(slice(16, 32), slice(32, 64)))
    assert read.images[0].shape == (8, 16, 3)
    assert read.images[0].mean() == pytest.approx(200.0, abs=4.0)
    assert read.source_size == (64, 48)


def test_a_text_file_named_mp4_is_refused_with_rule_value_and_remedy(tmp_path):
    path = tmp_path / "story.mp4"
    path.write_text("once upon a time")
    with pytest.raises(UnreadableClip, match=r"story\.mp4 must be a video.*got 16 bytes.*export"):
        read_video(path)


def test_an_empty_and_an_absent_file_are_refused(tmp_path):
    empty = tmp_path / "empty.mp4"
    empty.touch()
    with pytest.raises(UnreadableClip, match="got 0 bytes"):
        read_video(empty)
    with pytest.raises(UnreadableClip, match="must be a file; got none at"):
        read_video(tmp_path / "absent.mp4")


def test_sound_alone_is_no_video(tmp_path):
    path = tmp_path / "song.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), "fltp", "mono")
        frame.sample_rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(UnreadableClip, match="no picture in it"):
        read_video(path)


def test_a_clip_cut_short_gives_what_came_before(clip, tmp_path):
    data = clip.with_suffix(".mkv")
    write_video([np.full((48, 64, 3), 8 * i, dtype=np.uint8) for i in range(30)], data, 30)
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(data.read_bytes()[: int(data.stat().st_size * 0.8)])
    assert 1 <= len(read_video(cut).images) <= 30


def test_reading_stops_when_asked(clip):
    with pytest.raises(CaptureStopped):
        read_video(clip, should_stop=lambda: True)


def test_progress_reaches_the_end(clip):
    told: list[float] = []
    read_video(clip, on_progress=told.append)
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)


def test_spread_is_even_and_holds_both_ends():
    assert evenly_spaced(10, 4).tolist() == [0, 3, 6, 9]
    assert evenly_spaced(3, 10).tolist() == [0, 1, 2]


def test_shrink_leaves_small_pictures_alone():
    image = np.zeros((10, 20, 3), dtype=np.uint8)
    assert shrink(image, 20).shape == (10, 20, 3)
    assert shrink(image, 10).shape == (5, 10, 3)


def test_broken_time_stamps_give_way_to_an_even_rate():
    assert increasing([1.0, 1.5, 2.0], [0, 1, 2], 30.0) == pytest.approx([0.0, 0.5, 1.0])
    assert increasing([1.0, 1.0, 2.0], [0, 1, 2], 10.0) == pytest.approx([0.0, 0.1, 0.2])
    assert increasing([1.0, 1.0, 2.0], [0, 2, 4], 10.0) == pytest.approx([0.0, 0.2, 0.4])
    fast = [i / 1500.0 for i in range(4)]
    assert increasing(fast, [3, 4, 5, 6], 30.0) == pytest.approx([0.0, 1 / 30, 2 / 30, 0.1])
    assert increasing([0.0, 0.5, 1.0], [0, 100, 200], 200.0) == pytest.approx([0.0, 0.5, 1.0])


def test_a_clip_written_without_time_stamps_is_read_at_a_usual_rate(tmp_path):
    path = tmp_path / "clip.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width = stream.height = 64
        stream.pix_fmt = "yuv420p"
        for number in range(12):
            frame = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 20 * number, np.uint8))
            frame.pts, frame.time_base = number, Fraction(1, 1500)
            container.mux(stream.encode(frame.reformat(format="yuv420p")))
        container.mux(stream.encode())
    clip = read_video(path)
    assert np.diff(clip.times_s) == pytest.approx(1.0 / 30.0, rel=0.05)


def test_a_phone_held_upright_is_shown_upright(tmp_path):
    image = np.zeros((48, 64, 3), dtype=np.uint8)
    image[:24, :32] = 255  # top left, before the turn
    path = tmp_path / "phone.mp4"
    write_video([image] * 4, path, 30)
    data = bytearray(path.read_bytes())
    # ISO 14496-12, 8.3.2: the track header's matrix; this one turns by 90 degrees clockwise
    matrix = struct.pack(">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, 48 << 16, 0, 1 << 30)
    place = data.index(b"tkhd") + 44
    data[place : place + 36] = matrix
    path.write_bytes(data)
    clip = read_video(path)
    assert clip.source_size == (48, 64)
    shown = clip.images[0].mean(axis=2)
    assert shown.shape == (64, 48)
    assert shown[:32, 24:].mean() > 240.0  # top right
    assert shown[32:].mean() < 15.0
