"""What is recorded, as bytes: tracks of records, some seconds of each in a chunk.

A chunk is zlib (RFC 1950) over records, little endian: u32 moment (ms from the recording's start,
pauses left out), u16 length, then so many bytes.

| track | a record |
| --- | --- |
| `motion:PERFORMER` | a pose packet (services.live.packets), in the room |
| `voice:PARTICIPANT` | an Opus packet (RFC 6716), as its speaker's device encoded it |
| `chat:PARTICIPANT` | what they wrote, UTF-8 |
| `room` | JSON: the place, and who stands where; see `services.recording.recorder` |

A minute of somebody takes about 200 kB of motion at 30 poses a second, 240 kB of voice while they
talk at 32 kbit/s, and next to nothing else.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from scene.errors import InvalidInput

_HEAD = struct.Struct("<IH")
LONGEST_RECORD = (1 << 16) - 1
_LARGEST_CHUNK_BYTES = 64 << 20
"""Unpacked: far more than some seconds of anything take."""


@dataclass(frozen=True)
class Record:
    """Something that happened."""

    at_ms: int
    data: bytes


def pack(records: Iterable[Record]) -> bytes:
    """The chunk that holds `records`. Raises InvalidInput for one that is too long."""
    parts: list[bytes] = []
    for record in records:
        if len(record.data) > LONGEST_RECORD:
            raise InvalidInput(
                f"a record must have at most {LONGEST_RECORD} bytes; got {len(record.data)}"
            )
        parts.append(_HEAD.pack(record.at_ms, len(record.data)) + record.data)
    return zlib.compress(b"".join(parts))


def unpack(chunk: bytes) -> bytes:
    """The records of a chunk, one after the other. Raises InvalidInput for what is no chunk."""
    stream = zlib.decompressobj()
    try:
        records = stream.decompress(chunk, _LARGEST_CHUNK_BYTES)
    except zlib.error as error:
        raise InvalidInput(f"a chunk must be zlib; got bytes that are not: {error}") from error
    if not stream.eof:
        raise InvalidInput(
            f"a chunk must be whole zlib of at most {_LARGEST_CHUNK_BYTES >> 20} MiB; got "
            f"{len(records)} bytes and no end"
        )
    return records


def records_of(data: bytes) -> Iterator[Record]:
    """The records in unpacked bytes. Raises InvalidInput where they break off."""
    at = 0
    while at < len(data):
        if at + _HEAD.size > len(data):
            raise InvalidInput(f"records must be whole; got {len(data) - at} bytes of a header")
        at_ms, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if at + length > len(data):
            raise InvalidInput(f"records must be whole; got {len(data) - at} of {length} bytes")
        yield Record(at_ms, data[at : at + length])
        at += length
