"""The packet of the channel `keypoints`: one person in one picture of a webcam, packed in bits.

Header as in `services.live.packets`, 16 bytes, of version 2; its u16 holds in 15 bits how old the
picture was when the packet left, ms, and in the highest whether live look is on. Then u16 width,
u16 height (px of the picture), i16 xy of the body's middle (1/8192 of the picture's sides), u16
scales of the body's xy, the body's world, the details' xy and the details' world (1/8192 of a side,
or of a metre); then numbers of a few bits, least significant first, without gaps:

- of the thirteen landmarks of the body (`BODY`), 9 bits each: xy from the body's middle, then xyz
  of the world,
- of the other twenty, 6 bits each: the same, from the landmark that each belongs to (`ANCHORS`),
- visibility of all 33, 3 bits each,
- where face or hands were seen: 17 numbers of `scene.expression`, 6 bits each, and 3 bits of what
  is known (`capture.body.expressions`),
- after these, from the next byte on and where the face tells it: the head's rotation, 32 bits
  (`scene.smallest_three`, 10 bits a component). Whoever looks at face and hands by turns has one in
  every other picture.

A number of n bits is a share of its scale from -1 (0) to 1 (2^n - 2), or from 0 to 1 (2^n - 1). A
face's, hand's and foot's parts are so near to what they belong to that few bits place them finely.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

import numpy as np

from capture.body.expressions import ALL_GROUPS, ObservedExpression
from capture.body.landmark_names import LANDMARK_COUNT, LANDMARK_NAMES
from scene.arrays import Array, Float, Int
from scene.expression import EXPRESSION_COUNT
from scene.rotations import matrix_to_quaternion, quaternion_to_matrix
from scene.smallest_three import pack_quaternions, unpack_quaternions
from services.live.packets import HEADER, Kind, PacketError, header_of

KEYPOINTS_VERSION = 2
_HEAD = struct.Struct("<HH2h4H")
_STEPS = 8192
"""To a metre, or to a side of the picture."""
_BODY_BITS, _DETAIL_BITS, _VISIBILITY_BITS, _EXPRESSION_BITS, _KNOWN_BITS = 9, 6, 3, 6, 3
_OLDEST_MS = 0x7FFF
_LIVE_LOOK = 0x8000
_DETAILS = (
    ("nose", LANDMARK_NAMES[1:11]),
    *((f"{s}_wrist", [f"{s}_{f}" for f in ("pinky", "index", "thumb")]) for s in ("left", "right")),
    *((f"{s}_ankle", [f"{s}_heel", f"{s}_foot_index"]) for s in ("left", "right")),
)
"""Landmarks, and those that belong to each."""
DETAILS: Int[Array, "20"] = np.array(
    [LANDMARK_NAMES.index(name) for _, names in _DETAILS for name in names]
)
ANCHORS: Int[Array, "20"] = np.array(
    [LANDMARK_NAMES.index(anchor) for anchor, names in _DETAILS for _ in names]
)
"""What each of `DETAILS` belongs to."""
BODY: Int[Array, "13"] = np.setdiff1d(np.arange(LANDMARK_COUNT), DETAILS)
_FIELDS = (
    (2 * len(BODY), _BODY_BITS),
    (3 * len(BODY), _BODY_BITS),
    (2 * len(DETAILS), _DETAIL_BITS),
    (3 * len(DETAILS), _DETAIL_BITS),
    (LANDMARK_COUNT, _VISIBILITY_BITS),
)
_PLACES = {bits: 1 << np.arange(bits) for bits in (_KNOWN_BITS, _DETAIL_BITS, _BODY_BITS)}
"""What each bit of a number of so many is worth: made once, for packets come thousands a second."""
_EXPRESSION_FIELDS = ((EXPRESSION_COUNT, _EXPRESSION_BITS), (1, _KNOWN_BITS))


def _bytes_of(fields: tuple[tuple[int, int], ...]) -> int:
    bits = sum(count * width for count, width in fields)
    return HEADER.size + _HEAD.size + -(-bits // 8)


KEYPOINTS_BYTES = _bytes_of(_FIELDS)
"""Of a packet in which nothing is known of face and hands."""
EXPRESSION_KEYPOINTS_BYTES = _bytes_of(_FIELDS + _EXPRESSION_FIELDS)
"""Of one that tells of face and hands, but not how the head is turned."""
_ROTATION_BITS, _ROTATION_BYTES = 10, 4
LONGEST_KEYPOINTS_BYTES = EXPRESSION_KEYPOINTS_BYTES + _ROTATION_BYTES


@dataclass(frozen=True, eq=False)
class KeypointsPacket:
    """What a webcam shows of one person: landmarks, and no picture."""

    sequence: int
    capture_time_ms: float
    width: int
    height: int
    """px, of the picture."""
    xy: Float[Array, "33 2"]
    """Position of each landmark, as shares of width and height; outside 0 to 1 it is a guess."""
    world: Float[Array, "33 3"]
    """m, origin between the hips, axes of the camera: x right, y down, z away from it."""
    visibility: Float[Array, "33"]
    """0 (hidden or outside) to 1 (seen)."""
    expression: ObservedExpression | None = None
    """Of face and fingers, where they were detected."""
    age_ms: int = 0
    """Time from the picture's capture to the packet's leaving: what finding landmarks took."""
    live_look: bool = False
    """Whether pictures of the person travel with the landmarks (`services.live.look`)."""
    head: Float[Array, "3 3"] | None = None
    """The head's rotation by the face's points in this very picture, from rest to the camera, x
    right, y up, z towards it; travels with an expression alone."""


def encode_keypoints(packet: KeypointsPacket) -> bytes:
    """The bytes of `packet`; what is out of range is moved to the range's end."""
    low, high = packet.xy[BODY].min(axis=0), packet.xy[BODY].max(axis=0)
    middle = np.clip(_rounded(0.5 * (low + high) * _STEPS), -32768, 32767)
    offsets = (
        packet.xy[BODY] - middle / _STEPS,
        packet.world[BODY],
        packet.xy[DETAILS] - packet.xy[ANCHORS],
        packet.world[DETAILS] - packet.world[ANCHORS],
    )
    scales = [min(math.ceil(_STEPS * float(np.abs(one).max())), 0xFFFF) for one in offsets]
    numbers = [
        _signed(one.ravel(), scale / _STEPS, width)
        for one, scale, (_, width) in zip(offsets, scales, _FIELDS[:4], strict=True)
    ]
    numbers.append(_unsigned(packet.visibility, _VISIBILITY_BITS))
    fields, seen = _FIELDS, packet.expression
    if seen is not None:
        fields = _FIELDS + _EXPRESSION_FIELDS
        numbers += [_unsigned(seen.values, _EXPRESSION_BITS), np.array([seen.known & ALL_GROUPS])]
    age_ms = min(max(packet.age_ms, 0), _OLDEST_MS)
    version = KEYPOINTS_VERSION
    told = age_ms | _LIVE_LOOK * packet.live_look
    header = HEADER.pack(version, Kind.KEYPOINTS, told, packet.sequence, packet.capture_time_ms)
    scaled = _HEAD.pack(packet.width, packet.height, *middle, *scales)
    head = b"" if seen is None or packet.head is None else _packed_rotation(packet.head)
    return header + scaled + _pack(numbers, fields) + head


def decode_keypoints(data: bytes) -> KeypointsPacket:
    """Read a keypoints packet. Raises PacketError with the rule that `data` breaks."""
    sizes = (KEYPOINTS_BYTES, EXPRESSION_KEYPOINTS_BYTES, LONGEST_KEYPOINTS_BYTES)
    flags, sequence, capture_time_ms = header_of(data, Kind.KEYPOINTS, sizes, KEYPOINTS_VERSION)
    width, height, x, y, *scales = _HEAD.unpack_from(data, HEADER.size)
    if not math.isfinite(capture_time_ms) or not (width and height):
        raise PacketError(
            "a keypoints packet must have a finite capture time and a picture of some size; "
            f"got {capture_time_ms}, {width} x {height}"
        )
    told = len(data) >= EXPRESSION_KEYPOINTS_BYTES
    numbers = _unpack(data, _FIELDS + _EXPRESSION_FIELDS if told else _FIELDS)
    body_xy, body_world, detail_xy, detail_world = (
        _from_signed(one, scale / _STEPS, bits).reshape(len(one) // axes, axes)
        for one, scale, (_, bits), axes in zip(numbers, scales, _FIELDS, (2, 3, 2, 3), strict=False)
    )
    xy, world = np.empty((LANDMARK_COUNT, 2)), np.empty((LANDMARK_COUNT, 3))
    xy[BODY], world[BODY] = body_xy + np.array([x, y]) / _STEPS, body_world
    xy[DETAILS], world[DETAILS] = xy[ANCHORS] + detail_xy, world[ANCHORS] + detail_world
    visibility = numbers[4] / _most(_VISIBILITY_BITS)
    expression = None
    if told:
        values = numbers[5] / _most(_EXPRESSION_BITS)
        expression = ObservedExpression(values, int(numbers[6][0]) & ALL_GROUPS)
    return KeypointsPacket(
        sequence,
        capture_time_ms,
        width,
        height,
        xy,
        world,
        visibility,
        expression,
        flags & _OLDEST_MS,
        bool(flags & _LIVE_LOOK),
        _rotation_in(data) if len(data) == LONGEST_KEYPOINTS_BYTES else None,
    )


def _packed_rotation(rotation: Float[Array, "3 3"]) -> bytes:
    packed = pack_quaternions(matrix_to_quaternion(rotation[None]), _ROTATION_BITS)
    return int(packed[0]).to_bytes(_ROTATION_BYTES, "little")


def _rotation_in(data: bytes) -> Float[Array, "3 3"]:
    packed = np.array([int.from_bytes(data[-_ROTATION_BYTES:], "little")])
    return quaternion_to_matrix(unpack_quaternions(packed, _ROTATION_BITS))[0]


def _most(bits: int) -> int:
    return (1 << bits) - 1


def _signed(values: Float[Array, "N"], scale: float, bits: int) -> Int[Array, "N"]:
    limit = _most(bits - 1)
    shares = values / scale if scale else np.zeros(len(values))
    return _rounded(limit * np.clip(shares, -1.0, 1.0)) + limit


def _from_signed(numbers: Int[Array, "N"], scale: float, bits: int) -> Float[Array, "N"]:
    limit = _most(bits - 1)
    return scale * (numbers - limit) / limit


def _unsigned(shares: Float[Array, "N"], bits: int) -> Int[Array, "N"]:
    return _rounded(_most(bits) * np.clip(shares, 0.0, 1.0))


def _rounded(values: Float[Array, "N"]) -> Int[Array, "N"]:
    """Halves up, as a page rounds."""
    return np.floor(values + 0.5).astype(int)


def _pack(numbers: list[Int[Array, "N"]], fields: tuple[tuple[int, int], ...]) -> bytes:
    bits = [
        (one[:, None] >> np.arange(width) & 1).ravel()
        for one, (_, width) in zip(numbers, fields, strict=True)
    ]
    return np.packbits(np.concatenate(bits).astype(np.uint8), bitorder="little").tobytes()


def _unpack(data: bytes, fields: tuple[tuple[int, int], ...]) -> list[Int[Array, "N"]]:
    packed = np.frombuffer(data, np.uint8, offset=HEADER.size + _HEAD.size)
    bits, at, numbers = np.unpackbits(packed, bitorder="little"), 0, []
    for count, width in fields:
        field = bits[at : at + count * width].reshape(count, width)
        numbers.append(field @ _PLACES[width])
        at += count * width
    return numbers
