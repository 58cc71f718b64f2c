"""Video as a viewer's decoder takes it: key frames when asked, steps of bitrate, what is chosen."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from aiortc import RTCPeerConnection
from aiortc.codecs import get_decoder, get_encoder
from aiortc.codecs.h264 import H264PayloadDescriptor
from aiortc.rtcrtpparameters import RTCRtpCodecParameters
from av import CodecContext, VideoFrame
from av.video.codeccontext import VideoCodecContext

from services.live.streaming.encoding import (
    BITRATES,
    BitrateSteps,
    Codec,
    PictureEncoder,
    negotiated_codec,
)

SIZE = 128


def picture(tick: int, size: int = SIZE) -> VideoFrame:
    """A bright square that moves over a ramp."""
    rgb = np.broadcast_to(np.linspace(0, 200, size, dtype=np.uint8)[:, None, None], (size, size, 3))
    rgb = rgb.copy()
    rgb[20:60, 5 + 2 * tick % 60 :][:, :30] = (250, 120, 30)
    return VideoFrame.from_ndarray(rgb, format="rgb24").reformat(format="yuv420p")


def decoder(codec: Codec) -> VideoCodecContext:
    return CodecContext.create("h264" if codec is Codec.H264 else "libvpx", "r")


def apart(one: VideoFrame, other: VideoFrame) -> float:
    a, b = (f.to_ndarray(format="gray").astype(float) for f in (one, other))
    return float(np.abs(a - b).mean())


@pytest.mark.parametrize("codec", Codec)
def test_each_picture_goes_in_and_comes_out_at_once(codec):
    encoder, shows = PictureEncoder(codec), decoder(codec)
    for tick in range(7, 27):
        packet = encoder.encode(picture(tick), tick, BITRATES[3], key=False)
        assert packet.is_keyframe == (tick == 7)
        assert packet.pts is not None
        assert packet.time_base is not None
        assert float(packet.pts * packet.time_base) == pytest.approx(tick / 30)
        (shown,) = shows.decode(packet)
        assert apart(cast(VideoFrame, shown), picture(tick)) < 3.0


@pytest.mark.parametrize("codec", Codec)
def test_a_key_frame_comes_to_whom_it_was_asked_for_alone(codec):
    """Viewers of one picture share the frame."""
    one, other = PictureEncoder(codec), PictureEncoder(codec)
    keys: list[tuple[bool, bool]] = []
    for tick in range(6):
        shared = picture(tick)
        mine = one.encode(shared, tick, BITRATES[3], key=tick == 3)
        theirs = other.encode(shared, tick, BITRATES[3], key=False)
        keys.append((mine.is_keyframe, theirs.is_keyframe))
    assert keys == [(True, True), *[(False, False)] * 2, (True, False), *[(False, False)] * 2]
    late = decoder(codec)
    (shown,) = late.decode(one.encode(picture(9), 9, BITRATES[3], key=True))
    assert apart(cast(VideoFrame, shown), picture(9)) < 3.0


@pytest.mark.parametrize("codec", Codec)
def test_another_size_begins_with_a_key_frame(codec):
    encoder = PictureEncoder(codec)
    encoder.encode(picture(0), 0, BITRATES[3], key=False)
    packet = encoder.encode(picture(1, 64), 1, BITRATES[3], key=False)
    assert packet.is_keyframe
    (shown,) = decoder(codec).decode(packet)
    assert cast(VideoFrame, shown).width == 64


def test_h264_takes_another_bitrate_without_a_key_frame():
    rng = np.random.default_rng(0)
    clouds = np.kron(rng.integers(0, 255, (80, 80, 3), np.uint8), np.ones((5, 5, 1), np.uint8))
    encoder, sizes = PictureEncoder(Codec.H264), []
    for tick in range(90):
        x, y = rng.integers(0, 100, 2)
        cut = np.ascontiguousarray(clouds[y : y + 256, x : x + 256])
        frame = VideoFrame.from_ndarray(cut, format="rgb24").reformat(format="yuv420p")
        packet = encoder.encode(frame, tick, BITRATES[-1 if tick < 45 else 0], key=False)
        assert packet.is_keyframe == (tick == 0)
        sizes.append(packet.size)
    assert np.mean(sizes[-20:]) < 0.5 * np.mean(sizes[25:45])


@pytest.mark.parametrize("codec", Codec)
def test_aiortc_cuts_packets_that_a_decoder_joins(codec):
    parameters = RTCRtpCodecParameters(f"video/{codec}", 90000, None, 97)
    packer, joiner = get_encoder(parameters), get_decoder(parameters)
    packet = PictureEncoder(codec).encode(picture(0), 0, BITRATES[-1], key=True)
    payloads, timestamp = packer.pack(packet)
    assert timestamp == 0
    assert all(len(payload) <= 1300 for payload in payloads)
    assert joiner is not None
    if codec is Codec.H264:
        joined = b"".join(H264PayloadDescriptor.parse(payload)[1] for payload in payloads)
        assert decoder(codec).decode(type(packet)(joined))


def test_estimates_that_swing_leave_the_step_alone():
    steps = BitrateSteps()
    first = steps.bitrate
    for estimate in (1.02, 1.1, 1.01, 1.14, 1.0):
        steps.on_estimate(estimate * first)
        assert steps.bitrate == first
    steps.on_estimate(0.99 * first)
    lower = steps.bitrate
    assert lower < first
    steps.on_estimate(1.05 * first)
    assert steps.bitrate == lower
    steps.on_estimate(1.2 * first)
    assert steps.bitrate == first
    steps.on_estimate(1.0)
    assert steps.bitrate == BITRATES[0]
    steps.on_estimate(1e12)
    assert steps.bitrate == BITRATES[-1]


def test_a_line_that_loses_packets_bounds_the_bitrate_until_it_has_room():
    steps = BitrateSteps()
    steps.on_estimate(1e9)
    assert steps.bitrate == BITRATES[-1]
    steps.on_loss(0.05)  # more than now and then, and not full
    assert steps.bitrate == BITRATES[-1]
    found = []
    for _ in range(12):
        steps.on_loss(0.8)
        found.append(steps.bitrate)
    assert found == sorted(found, reverse=True)
    assert found[-1] == BITRATES[0]
    for _ in range(60):
        steps.on_loss(0.0)
    assert steps.bitrate == BITRATES[-1]
    steps.on_loss(1.0)
    steps.on_estimate(1e9)  # that delays are short says nothing of losses
    assert steps.bitrate < BITRATES[-1]


async def test_h264_is_chosen_where_it_is_offered_as_we_send_it():
    peer = RTCPeerConnection()
    peer.addTransceiver("video", direction="recvonly")
    offer = (await peer.createOffer()).sdp
    await peer.close()
    assert negotiated_codec(offer) is Codec.H264
    assert (
        negotiated_codec(offer.replace("packetization-mode=1", "packetization-mode=0")) is Codec.VP8
    )
    main = offer.replace("42e01f", "4d001f").replace("42001f", "4d001f")
    assert negotiated_codec(main) is Codec.VP8
    assert negotiated_codec("v=0\r\na=rtpmap\r\na=fmtp:\r\nm=video 9\r\n") is Codec.VP8
