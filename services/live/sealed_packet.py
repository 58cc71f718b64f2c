"""The packet of the channel `motion` in a sealed meeting, which this server passes on unread.

u8 version, u8 kind SEALED_MOTION, u16 zero, u32 counter, u8 salt[16], all of which the seal covers
too; then a motion packet without live look (`services.live.motion.motion_packet`), encrypted by
AES-128-GCM (NIST SP 800-38D), and its tag of 16 bytes: 318 bytes, always. As in SFrame (RFC 9605) a
header says which key it is and counts up; nothing else of it is to be known on the way.

The key is HKDF-SHA256 (RFC 5869) of the meeting's key, which is in the fragment of its link, with
the salt, which a page draws anew for each connection, and the text `metanerf motion 1`, the
meeting's id and the performer's, by single spaces: no packet opens as another's. The nonce is the
counter, 12 bytes little endian, and never comes again under one key. Pages refuse what does not
open, what comes again, and what is no motion of a person (`client/src/sealing/`).

To viewers, in messages of the channel `pose`: u8 version, u8 kind SEALED_BATCH, then for each
performer who moved u8 index, u8 count and u16 check, as of a pose packet, and the packet.
"""

from __future__ import annotations

import struct

from services.live.packets import LONGEST_BATCH, VERSION, Kind, PacketError, performer_check
from services.live.room import Room

_HEAD = struct.Struct("<BBHI")
_SALT_BYTES, _MOTION_BYTES, _TAG_BYTES = 16, 278, 16
SEALED_BYTES = _HEAD.size + _SALT_BYTES + _MOTION_BYTES + _TAG_BYTES
_WHOSE = struct.Struct("<BBH")
_BATCH_HEAD = bytes([VERSION, Kind.SEALED_BATCH])
_IN_A_BATCH = (LONGEST_BATCH - len(_BATCH_HEAD)) // (_WHOSE.size + SEALED_BYTES)


def require_sealed(data: bytes) -> None:
    """Raises PacketError for what cannot be a sealed motion packet."""
    if len(data) != SEALED_BYTES:
        raise PacketError(f"sealed motion must be {SEALED_BYTES} bytes long; got {len(data)}")
    version, kind, zero, _ = _HEAD.unpack_from(data)
    if (version, kind, zero) != (VERSION, Kind.SEALED_MOTION, 0):
        raise PacketError(
            f"sealed motion must be version {VERSION}, kind {int(Kind.SEALED_MOTION)}, then zero; "
            f"got {version}, {kind}, {zero}"
        )


def take_batches(room: Room) -> list[bytes]:
    """What came of everybody in a sealed room since the last time, for its viewers."""
    members = room.performers
    records = [
        _WHOSE.pack(index, len(members), performer_check(member.performer_id)) + packet
        for index, member in enumerate(members)
        if (packet := room.sealed_motions.pop(member.performer_id, None)) is not None
    ]
    return [
        _BATCH_HEAD + b"".join(records[first : first + _IN_A_BATCH])
        for first in range(0, len(records), _IN_A_BATCH)
    ]
