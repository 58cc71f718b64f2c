"""A sender's frames can take nothing along but the process that decodes them."""

from __future__ import annotations

import logging
import os
import random
import signal
import sys
import threading
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from av import CodecContext, Packet
from av.video.codeccontext import VideoCodecContext

from services.live.look import decoder as decoder_module
from services.live.look.decoder import LOST, RESTART_S, DecodingFailed, LookDecoder
from services.live.look.picture_code import PictureCode
from services.live.look.receiver import FRAME_SIZE
from tests.fakes import Clock
from tests.services.attempts import nothing_is_reached
from tests.services.live.look_pictures import Encoder, decoding, frame_of
from tests.services.uploads.test_apart import NO_LANDLOCK, has_landlock


@cache
def stream() -> tuple[bytes, ...]:
    """A key frame and five that build on it."""
    encoder = Encoder()
    return tuple(encoder.encode(frame_of(PictureCode(66 * n, -20, 30, 360))) for n in range(6))


def lost() -> float:
    """How many processes were lost so far."""
    (family,) = LOST.collect()
    return family.samples[0].value


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def decoder(clock: Clock) -> Iterator[LookDecoder]:
    made = LookDecoder(FRAME_SIZE, lambda: clock().timestamp())
    yield made
    made.close()


def test_pixels_are_those_that_a_decoder_here_would_find(decoder: LookDecoder):
    context: VideoCodecContext = CodecContext.create("libvpx", "r")
    expected = [context.decode(Packet(data))[0].to_ndarray(format="rgb24") for data in stream()]
    first = decoder.newest(stream()[:1])
    assert first is not None
    np.testing.assert_array_equal(first, expected[0])
    assert first.flags.writeable
    # of several at once the last, which builds on all of them
    last = decoder.newest(stream()[1:])
    assert last is not None
    np.testing.assert_array_equal(last, expected[-1])


def test_damage_is_told_and_a_key_frame_mends_it(decoder: LookDecoder):
    with pytest.raises(DecodingFailed, match="damaged"):
        decoder.newest([stream()[0][:10] + b"\xff" * 9])
    assert decoder.newest([stream()[0]]) is not None


def test_frames_of_another_size_show_nothing(decoder: LookDecoder):
    large = Encoder((640, 480)).encode(frame_of(PictureCode(0, 0, 0, 9)).reformat(640, 480))
    assert decoder.newest([large]) is None


def test_random_frames_harm_nobody(decoder: LookDecoder, clock: Clock):
    whole, chance = stream()[0], random.Random(7)
    for _ in range(200):
        frame = bytearray(whole)
        for _ in range(chance.randrange(1, 30)):
            frame[chance.randrange(3 if chance.random() < 0.2 else 10, len(frame))] = (
                chance.randrange(256)
            )
        clock.advance(seconds=RESTART_S)
        try:
            decoder.newest([bytes(frame[: chance.randrange(3, len(frame) + 1)])])
        except DecodingFailed:
            continue
    clock.advance(seconds=RESTART_S)
    assert decoder.newest([whole]) is not None


@pytest.mark.parametrize(
    ("script", "told"),
    [
        ("kill -SEGV $$", "SIGSEGV"),
        ("echo MemoryError >&2; exit 1", "MemoryError"),
        # it says that a picture comes, and too little of it
        ("printf p; printf few; exit 3", "exit code 3"),
    ],
)
def test_a_crash_is_told_once_and_another_starts_later(
    instead, decoder: LookDecoder, clock: Clock, caplog, script: str, told: str
):
    program, before = sys.executable, lost()
    instead(script)
    with caplog.at_level(logging.WARNING), pytest.raises(DecodingFailed, match=told):
        decoder.newest(stream()[:1])
    assert lost() == before + 1.0
    assert f"what decodes somebody's pictures ended: {told}" in caplog.text
    sys.executable = program
    # frames that crash each process are not given another at once
    with pytest.raises(DecodingFailed, match="has ended"):
        decoder.newest(stream()[:1])
    clock.advance(seconds=RESTART_S)
    assert decoder.newest(stream()[:1]) is not None
    assert lost() == before + 1.0


@pytest.mark.parametrize("script", ["exec sleep 30", "exec >&-; exec sleep 30"])
def test_who_does_not_answer_is_ended(instead, monkeypatch: pytest.MonkeyPatch, script: str):
    monkeypatch.setattr(decoder_module, "START_S", 0.5)
    instead(script)
    # more than a pipe holds, so that giving it waits, too
    for frames in (stream()[:1], [bytes(1 << 20)]):
        decoder, before = LookDecoder(FRAME_SIZE), lost()
        started_s = time.monotonic()
        with pytest.raises(DecodingFailed, match="did not answer"):
            decoder.newest(frames)
        assert time.monotonic() - started_s < 5.0
        assert lost() == before + 1.0


def test_closing_ends_one_that_is_asked_at_the_moment(instead, decoder: LookDecoder):
    instead("exec sleep 30")
    failed = threading.Event()

    def ask() -> None:
        with pytest.raises(DecodingFailed):
            decoder.newest(stream()[:1])
        failed.set()

    asking, before = threading.Thread(target=ask), lost()
    asking.start()
    time.sleep(0.3)
    decoder.close()
    assert failed.wait(5.0)
    asking.join()
    assert lost() == before
    with pytest.raises(DecodingFailed, match="has ended"):
        decoder.newest(stream()[:1])


@pytest.mark.skipif(not has_landlock(), reason=NO_LANDLOCK)
def test_what_decodes_has_no_files_no_network_and_no_secrets(tmp_path: Path):
    nothing_is_reached("services.live.look.confined", tmp_path)


def test_one_that_is_killed_is_another_the_next_time(decoder: LookDecoder, clock: Clock):
    assert decoder.newest(stream()[:1]) is not None
    (process,) = decoding()
    os.kill(process, signal.SIGKILL)
    with pytest.raises(DecodingFailed, match="SIGKILL"):
        decoder.newest(stream()[1:2])
    clock.advance(seconds=RESTART_S)
    assert decoder.newest(stream()[:1]) is not None
