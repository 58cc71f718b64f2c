"""Opus packets as an Ogg file (RFC 3533, RFC 7845), with silence where nothing was said."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator

from services.recording.chunks import Record

OPUS_RATE = 48_000
_STEP = 960
"""Samples of a packet of 20 ms."""
_STEP_MS = 20
_SILENCE = bytes([0xF8, 0xFF, 0xFE])
"""20 ms of silence: one CELT frame, mono (RFC 6716, section 3.1)."""
_PAGE_PACKETS = 50
_FRAME_MS = {0: 10.0, 1: 20.0, 2: 40.0, 3: 60.0}
_PRE_SKIP = 312


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
    """Packets in time: gaps of more than a packet are filled, what came too early waits."""
    at = 0
    for record in records:
        due = record.at_ms * OPUS_RATE // 1000
        while due - at > 2 * _STEP:
            yield _SILENCE
            at += _STEP
        yield record.data
        at += samples_of(record.data)


def ogg_opus(packets: Iterable[bytes], serial: int = 1) -> Iterator[bytes]:
    """The pages of an Ogg Opus stream of one channel."""
    head = b"OpusHead" + struct.pack("<BBHIhB", 1, 1, _PRE_SKIP, OPUS_RATE, 0, 0)
    maker = b"metanerf"
    tags = b"OpusTags" + struct.pack("<I", len(maker)) + maker + struct.pack("<I", 0)
    yield _page([head], 0, serial, 0, first=True)
    yield _page([tags], 0, serial, 1)
    number, granule, waiting = 2, _PRE_SKIP, list[bytes]()
    for packet in packets:
        waiting.append(packet)
        granule += samples_of(packet)
        if len(waiting) == _PAGE_PACKETS or sum(len(one) // 255 + 1 for one in waiting) > 200:
            yield _page(waiting, granule, serial, number)
            number, waiting = number + 1, []
    yield _page(waiting, granule, serial, number, last=True)


def _page(
    packets: list[bytes], granule: int, serial: int, number: int, *, first: bool = False,
    last: bool = False,
) -> bytes:  # fmt: skip
    lacing = b"".join(b"\xff" * (len(one) // 255) + bytes([len(one) % 255]) for one in packets)
    flags = 2 * first | 4 * last
    head = struct.pack("<4sBBqIIIB", b"OggS", 0, flags, granule, serial, number, 0, len(lacing))
    page = head + lacing + b"".join(packets)
    return page[:22] + struct.pack("<I", _checksum(page)) + page[26:]


def _table() -> list[int]:
    table: list[int] = []
    for byte in range(256):
        value = byte << 24
        for _ in range(8):
            value = (value << 1 ^ 0x04C11DB7 if value & 0x80000000 else value << 1) & 0xFFFFFFFF
        table.append(value)
    return table


_TABLE = _table()


def _checksum(page: bytes) -> int:
    value = 0
    for byte in page:
        value = (value << 8 & 0xFFFFFFFF) ^ _TABLE[value >> 24 ^ byte]
    return value
