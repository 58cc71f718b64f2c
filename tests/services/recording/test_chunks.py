"""What is recorded comes back as it went, and what is broken is told."""

from __future__ import annotations

import io

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.errors import InvalidInput
from services.recording.chunks import LONGEST_RECORD, Record, pack, records_of, unpack
from services.recording.ogg import ogg_opus, samples_of, with_silence

RATE = 48_000


@given(st.lists(st.tuples(st.integers(0, 2**32 - 1), st.binary(max_size=300)), max_size=20))
def test_records_come_back_as_they_went(found):
    records = [Record(at, data) for at, data in found]
    assert list(records_of(unpack(pack(records)))) == records


def test_what_is_broken_is_told():
    with pytest.raises(InvalidInput, match="must be zlib"):
        unpack(b"no chunk")
    whole = unpack(pack([Record(5, b"hello")]))
    for end in (3, 8):
        with pytest.raises(InvalidInput, match="must be whole"):
            list(records_of(whole[:end]))
    with pytest.raises(InvalidInput, match="at most"):
        pack([Record(0, bytes(LONGEST_RECORD + 1))])


def voice(seconds: float, hertz: float = 440.0) -> list[bytes]:
    """Opus packets of a tone, as a browser sends them."""
    encoder = av.CodecContext.create("libopus", "w")
    encoder.format, encoder.layout, encoder.sample_rate = "s16", "mono", RATE
    encoder.bit_rate = 32_000
    packets: list[bytes] = []
    for start in range(0, int(seconds * RATE), 960):
        wave = 9000 * np.sin(2 * np.pi * hertz * (start + np.arange(960)) / RATE)
        frame = av.AudioFrame.from_ndarray(wave.astype(np.int16)[None], "s16", "mono")
        frame.sample_rate, frame.pts = RATE, start
        packets += [bytes(packet) for packet in encoder.encode(frame)]
    return packets


def test_a_packet_says_how_long_it_lasts():
    assert {samples_of(packet) for packet in voice(0.2)} == {960}
    assert samples_of(bytes([0xF8, 0xFF, 0xFE])) == 960
    assert samples_of(bytes([0b01101_0_11, 3])) == 3 * 960
    assert samples_of(b"") == 0


def test_others_read_the_ogg_and_silence_keeps_time():
    said = [Record(1000 + 20 * at, data) for at, data in enumerate(voice(0.5))]
    said += [Record(3000 + 20 * at, data) for at, data in enumerate(voice(0.5))]
    file = io.BytesIO(b"".join(ogg_opus(with_silence(said))))
    with av.open(file, "r") as container:
        frames = [frame.to_ndarray() for frame in container.decode(audio=0)]
    samples = np.concatenate(frames, axis=1)[0].astype(float)
    scale = 1.0 if np.abs(samples).max() <= 1.5 else 32768.0
    loud = np.abs(samples / scale)

    def level(start_s: float) -> float:
        return float(loud[int(start_s * RATE) : int((start_s + 0.3) * RATE)].mean())

    assert abs(len(samples) / RATE - 3.5) < 0.15
    assert level(0.2) < 1e-3 < 0.05 < level(1.1)
    assert level(2.0) < 1e-3 < 0.05 < level(3.1)


def test_after_a_pause_a_voice_is_in_time_within_a_packet():
    said = [Record(1019 + 20 * at, data) for at, data in enumerate(voice(0.2))]
    said += [Record(2505 + 20 * at, data) for at, data in enumerate(voice(0.2))]
    begins, at, before = [], 0, None
    for packet in with_silence(said):
        loud = len(packet) > 3
        if loud and not before:
            begins.append(1000 * at / RATE)
        at, before = at + samples_of(packet), loud
    assert begins == pytest.approx([1019.0, 2505.0], abs=20.0)


def test_the_ogg_has_the_packets_as_they_came_and_the_same_bytes_each_time():
    packets = [*voice(1.3), b"\xff" * 5, bytes([0xF8]) + bytes(1300), *voice(0.3)]
    pages = b"".join(ogg_opus(packets))
    with av.open(io.BytesIO(pages), "r") as container:
        read = [bytes(packet) for packet in container.demux(audio=0) if packet.size]
    assert read == packets
    assert b"".join(ogg_opus(packets)) == pages
