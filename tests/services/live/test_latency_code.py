"""The code of a capture time through both codecs, and what is no code."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from av import CodecContext, VideoFrame

from scene import Pose
from services.live.room import Room
from services.live.streaming import latency_code
from services.live.streaming.encoding import BITRATES, Codec, PictureEncoder
from services.live.streaming.yuv_planes import plane_rows


@pytest.mark.parametrize("codec", Codec)
def test_a_code_is_read_from_coded_pictures_even_of_the_lowest_bitrate(codec):
    rng = np.random.default_rng(1)
    rough = np.kron(rng.integers(0, 255, (64, 64, 3), np.uint8), np.ones((4, 4, 1), np.uint8))
    encoder = PictureEncoder(codec)
    shows = CodecContext.create("h264" if codec is Codec.H264 else "libvpx", "r")
    for tick in range(20):
        shifted = np.roll(rough, 3 * tick, axis=1)
        frame = VideoFrame.from_ndarray(shifted, format="rgb24").reformat(format="yuv420p")
        captured_ms = 1.7e12 + 33.4 * tick
        latency_code.write(frame, captured_ms)
        packet = encoder.encode(frame, tick, BITRATES[0], key=False)
        for shown in shows.decode(packet):
            luma = plane_rows(cast(VideoFrame, shown).planes[0])
            assert latency_code.read(luma) == int(captured_ms) % 65536


def test_times_of_all_sizes_are_told_apart():
    for value in (0, 1, 255, 4096, 65535):
        luma = np.kron(latency_code.cells(value), np.full((16, 16), 235)).astype(np.uint8)
        assert latency_code.read(luma) == value


@pytest.mark.parametrize("shade", [0, 255])
def test_a_plain_corner_is_no_code(shade):
    assert latency_code.read(np.full((64, 256), shade, np.uint8)) is None


def test_one_wrong_cell_is_noticed():
    code = latency_code.cells(12345)
    for cell in range(20):
        wrong = code.copy()
        wrong.flat[cell] ^= True
        assert latency_code.read(np.kron(wrong, np.full((16, 16), 235)).astype(np.uint8)) is None


class Driven:
    """Somebody whose webcam saw them at a known time."""

    captured_ms = 1.7e12 + 4321.0
    arrived_s = 50.0
    landmarks_age_ms = 35

    def pose_at(self, now_s: float) -> Pose:
        return Pose.rest(now_s)


def test_pictures_are_stamped_once_somebody_is_driven():
    code, room = latency_code.LatencyCode(), Room("m", ())
    assert code.stamp_ms(room) is None
    room.live_motions["p"] = Driven()
    assert code.stamp_ms(room) == Driven.captured_ms
