"""Opus packets as an Ogg file (RFC 3533, RFC 7845), with silence where nothing was said."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction

import av

from services.recording.chunks import Record

OPUS_RATE = 48_000
_STEP = 960
"""Samples of a packet of 20 ms."""
_SILENCE = bytes([0xF8, 0xFF, 0xFE])
"""20 ms of silence: one CELT frame, mono (RFC 6716, section 3.1)."""
_FRAME_MS = {0: 10.0, 1: 20.0, 2: 40.0, 3: 60.0}


def samples_of(packet: bytes) -> int:
    """Samples at 48 kHz that a packet lasts, by its first bytes (RFC 6716, section 3.1)."""
    if not packet:
        return 0
    config, code = packet[0] >> 3, packet[0] & 3
    if config < 12:
        frame_ms = _FRAME_MS[config & 3]
    elif config < 16:
        frame_ms = 20.0 if config & 1 else 10.0
    else:
        frame_ms = 2.5 * (1 << (config & 3))
    count = {0: 1, 1: 2, 2: 2}.get(code) or (packet[1] & 0x3F if len(packet) > 1 else 0)
    return int(frame_ms * count * OPUS_RATE / 1000)


def with_silence(records: Iterable[Record]) -> Iterator[bytes]:
    """Packets in time: gaps of more than two packets are filled, what came too early waits."""
    at = 0
    for record in records:
        due = record.at_ms * OPUS_RATE // 1000
        # whole: what was left of a gap would have the voice early until the next one
        for _ in range((due - at) // _STEP if due - at > 2 * _STEP else 0):
            yield _SILENCE
            at += _STEP
        yield record.data
        at += samples_of(record.data)


def ogg_opus(packets: Iterable[bytes]) -> Iterator[bytes]:
    """The bytes of an Ogg Opus stream of one channel, page by page."""
    file, at = _Written(), 0
    # bit-exact: the same packets give the same file, without a random serial number
    with av.open(file, "w", format="ogg", options={"fflags": "bitexact"}) as container:
        stream = container.add_stream("libopus", rate=OPUS_RATE, layout="mono")
        container.start_encoding()
        for data in packets:
            packet = av.Packet(data)
            packet.stream, packet.time_base = stream, Fraction(1, OPUS_RATE)
            packet.pts = packet.dts = at
            packet.duration = samples_of(data)
            at += packet.duration
            container.mux(packet)
            yield from file.taken()
    yield from file.taken()


class _Written:
    """A file that can only be written, emptied as it grows."""

    def __init__(self) -> None:
        self._pages: list[bytes] = []

    def write(self, data: bytes) -> int:
        self._pages.append(bytes(data))
        return len(data)

    def taken(self) -> list[bytes]:
        """What was written since the last call."""
        pages, self._pages = self._pages, []
        return pages
