"""Packets pass from one connection to others as they are, on one time line, nothing queued."""

from __future__ import annotations

from aiortc.rtp import RtpPacket

from services.live.streaming.forwarding import (
    EncodedPicture,
    ForwardedScreen,
    ForwardedVoice,
    OpusPacket,
    OpusPacketFilter,
)


class Seconds:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def say(payload: bytes, timestamp: int) -> OpusPacket:
    return OpusPacket(payload, timestamp, True)


async def test_time_goes_on_when_another_speaks_and_across_the_wrap():
    clock = Seconds()
    track = ForwardedVoice(clock)
    track.send("a", say(b"1", 0xFFFF_FFFF - 959))
    track.send("a", say(b"2", 0))
    clock.now += 2.0
    track.send("b", say(b"3", 77))
    got = [await track.recv() for _ in range(3)]
    assert [bytes(one) for one in got] == [b"1", b"2", b"3"]
    assert [one.pts for one in got] == [0, 960, 96_000]
    track.send("a", say(b"4", 5))  # at once: never back in time
    assert (await track.recv()).pts == 96_960


async def test_what_is_not_fetched_is_dropped_oldest_first():
    track = ForwardedVoice(Seconds())
    for number in range(30):
        track.send("a", say(bytes([number]), 960 * number))
    assert bytes(await track.recv()) == bytes([20])


async def test_a_screen_starts_with_a_whole_picture_and_asks_for_one():
    asked: list[int] = []
    track = ForwardedScreen(Seconds(), lambda: asked.append(1))
    track.send("a", EncodedPicture(b"delta", 0, False))
    assert asked == [1]
    track.send("a", EncodedPicture(b"key", 3000, True))
    track.send("a", EncodedPicture(b"delta", 6000, False))
    got = [await track.recv() for _ in range(2)]
    assert [bytes(one) for one in got] == [b"key", b"delta"]
    assert (got[1].pts or 0) - (got[0].pts or 0) == 3000


async def test_a_clogged_viewer_goes_on_from_the_next_whole_picture():
    asked: list[int] = []
    track = ForwardedScreen(Seconds(), lambda: asked.append(1))
    track.send("a", EncodedPicture(b"key", 0, True))
    for number in range(1, 20):
        track.send("a", EncodedPicture(b"delta", 3000 * number, False))
    assert asked
    track.send("a", EncodedPicture(b"new", 90_000, True))
    assert bytes(await track.recv()) == b"new"


def test_late_and_empty_packets_are_left_out():
    taken: list[bytes] = []
    filter_ = OpusPacketFilter(lambda packet: taken.append(packet.payload))
    for timestamp, payload in ((960, b"1"), (2880, b"3"), (1920, b"2"), (3840, b""), (4800, b"4")):
        packet = RtpPacket(payload_type=96, sequence_number=timestamp // 960, timestamp=timestamp)
        packet.payload, packet.ssrc = payload, 7
        filter_.receive(packet)
    assert taken == [b"1", b"3", b"4"]
