"""Whose pictures are looked at, and until when."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from prometheus_client import REGISTRY

from services.live.look.picture import LookPicture, PoseRequest
from services.live.look.picture_code import PictureCode
from services.live.look.receiver import SILENCE_S, LookReceiver, key_frame_size, offers_pictures
from tests.services.live.look_pictures import Encoder, KeptPictures, decoding, frame_of


def count(outcome: str) -> float:
    """Pictures that this became of, so far."""
    return REGISTRY.get_sample_value("metanerf_look_pictures_total", {"outcome": outcome}) or 0.0


def code(number: int) -> PictureCode:
    """Of the picture of this number."""
    return PictureCode(1000 + 66 * number, -20, 30, 360)


@cache
def stream() -> tuple[bytes, ...]:
    """Encoded pictures, numbered from 0: a key frame, and seven that build on it."""
    encoder = Encoder()
    return tuple(encoder.encode(frame_of(code(number))) for number in range(8))


class Asked:
    """How often a key frame was asked for."""

    def __init__(self) -> None:
        self.times = 0

    async def __call__(self) -> None:
        self.times += 1


class Ends:
    """A receiver, who asks, and what is shown."""

    def __init__(self) -> None:
        self.executor = ThreadPoolExecutor(1)
        self.asked, self.sink = Asked(), KeptPictures()
        self.receiver = LookReceiver(self.executor, self.asked)

    def send(self, *numbers: int) -> None:
        """Have these pictures of the stream come at once."""
        for number in numbers:
            self.receiver.on_frame(stream()[number])

    async def shown(self, pictures: int) -> None:
        """Wait until so many have been shown."""
        for _ in range(2000):  # the first waits for a process to start
            if len(self.sink.pictures) >= pictures:
                return
            await asyncio.sleep(0.01)
        raise AssertionError(f"{pictures} pictures were not shown; got {len(self.sink.pictures)}")


@pytest.fixture
async def ends() -> AsyncIterator[Ends]:
    made = Ends()
    yield made
    made.receiver.close()
    made.executor.shutdown()


async def test_a_picture_arrives_with_its_time_window_and_matte(ends):
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    ends.send(0)
    await ends.shown(1)
    (picture,) = ends.sink.pictures
    assert picture.captured_ms == 1000
    assert picture.window == (-20, 30, 360)
    assert picture.rgb.shape == (384, 384, 3)
    assert picture.matte.shape == (384, 384)
    np.testing.assert_allclose(picture.rgb[110:270, 110:270].mean((0, 1)), [40, 90, 200], atol=6)
    assert picture.rgb[:80].max() < 10
    assert picture.matte[110:270, 110:270].min() > 245
    assert picture.matte[:80].max() < 10


async def test_pictures_of_nobody_are_refused_unseen(ends):
    before = count("refused")
    ends.receiver.announce(True)
    ends.send(0)  # nobody is driven over this connection
    ends.receiver.attach(ends.sink)
    ends.send(1)  # nobody has said that live look is on
    assert count("refused") == before + 2
    ends.receiver.announce(True)
    ends.send(2)  # builds on what was refused
    await asyncio.sleep(0)
    assert ends.asked.times == 1
    assert ends.sink.pictures == []
    ends.send(0, 1)
    await ends.shown(1)
    assert ends.sink.pictures[-1].captured_ms == code(1).captured_ms


async def test_of_pictures_that_wait_the_newest_wins(ends):
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    before = count("replaced")
    ends.send(0, 1, 2, 3)
    await ends.shown(1)
    assert [one.captured_ms for one in ends.sink.pictures] == [code(3).captured_ms]
    assert count("replaced") == before + 3


async def test_switched_off_it_stops_at_once_and_for_good(ends):
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    ends.send(0)
    await ends.shown(1)
    ends.send(1)
    await asyncio.sleep(0)  # it is being decoded
    ends.receiver.announce(False)
    assert ends.sink.stops == 1
    ends.send(2)
    await asyncio.sleep(0.2)
    assert len(ends.sink.pictures) == 1
    ends.receiver.announce(True)
    ends.send(0)
    await ends.shown(2)


async def test_whose_pictures_they_no_longer_are_is_shown_none(ends):
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    ends.send(0)
    await ends.shown(1)
    other = KeptPictures()
    ends.receiver.attach(other)
    assert (ends.sink.stops, other.stops) == (1, 0)
    ends.receiver.announce(True)
    ends.send(0, 1)
    for _ in range(1000):
        await asyncio.sleep(0.01)
        if other.pictures:
            break
    assert (len(ends.sink.pictures), len(other.pictures)) == (1, 1)
    ends.receiver.detach(other)
    assert other.stops > 0


async def test_an_error_of_a_sink_does_not_end_the_pictures(ends, caplog):
    class Broken(KeptPictures):
        def receive(self, picture: LookPicture, request: PoseRequest | None = None) -> None:
            super().receive(picture, request)
            if len(self.pictures) == 1:
                raise ValueError("no place for a picture")

    ends.sink = Broken()
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    ends.send(0)
    await ends.shown(1)
    await asyncio.sleep(0.05)
    assert "no place for a picture" in caplog.text
    ends.send(1)
    await ends.shown(2)


async def test_without_news_it_stops_by_itself(ends):
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    ends.send(0)
    await ends.shown(1)
    await asyncio.sleep(0.6 * SILENCE_S)
    ends.send(1)
    await ends.shown(2)
    last_s = time.monotonic()
    while ends.sink.stops == 0 and time.monotonic() - last_s < 5.0 * SILENCE_S:
        await asyncio.sleep(0.01)
    assert ends.sink.stops == 1
    assert time.monotonic() - last_s > 0.9 * SILENCE_S


async def test_other_sizes_are_not_decoded_and_another_key_frame_is_asked_for(ends):
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    before = count("unreadable")
    large = Encoder((640, 480))
    frames = [large.encode(frame_of(code(number)).reformat(640, 480)) for number in range(3)]
    for data in frames:
        ends.receiver.on_frame(data)
    await asyncio.sleep(0)
    assert count("unreadable") == before + 3
    assert ends.asked.times == 1
    ends.send(0)
    await ends.shown(1)


async def test_what_holds_no_code_or_is_damaged_is_counted(ends):
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    before = count("unreadable")
    blank = frame_of(code(0))
    blank.planes[0].update(bytes(blank.planes[0].buffer_size))
    for damaged in (Encoder().encode(blank), stream()[0][:10] + b"\xff" * 9):
        ends.receiver.on_frame(damaged)
        before += 1
        for _ in range(1000):
            await asyncio.sleep(0.01)
            if count("unreadable") == before:
                break
        assert count("unreadable") == before
    assert ends.sink.pictures == []
    ends.send(0)
    await ends.shown(1)


async def test_a_frame_larger_than_any_of_a_page_is_not_decoded(ends):
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    before = count("unreadable")
    ends.receiver.on_frame(stream()[0] + bytes(1 << 17))
    assert count("unreadable") == before + 1
    ends.send(0)
    await ends.shown(1)


async def test_what_decodes_ends_with_the_connection(ends):
    ends.receiver.attach(ends.sink)
    ends.receiver.announce(True)
    ends.send(0)
    await ends.shown(1)
    (process,) = decoding()
    ends.receiver.close()
    async with asyncio.timeout(5.0):
        while Path(f"/proc/{process}").exists():
            await asyncio.sleep(0.01)
    ends.send(0)  # what comes late is nobody's
    assert len(ends.sink.pictures) == 1


def test_only_key_frames_tell_a_size():
    key, next_one, *_ = stream()
    assert key_frame_size(key) == (384, 528)
    assert key_frame_size(next_one) is None
    for length in range(10):
        assert key_frame_size(key[:length]) is None


def test_a_place_for_pictures_is_a_second_video_that_sends():
    def sections(*directions: str) -> str:
        return "v=0\r\n" + "".join(f"m=video 9 X 96\r\na={d}\r\n" for d in directions)

    assert offers_pictures(sections("recvonly", "sendonly"))
    assert offers_pictures(sections("recvonly", "sendonly") + "m=application 9 X\r\n")
    assert not offers_pictures(sections("recvonly"))
    assert not offers_pictures(sections("sendonly"))
    assert not offers_pictures(sections("recvonly", "recvonly"))
    assert not offers_pictures(sections("recvonly") + "m=audio 9 X 111\r\na=sendonly\r\n")
