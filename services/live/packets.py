"""Packets of the data channels: little endian, versioned, sequence and capture time first.

Header, 16 bytes: u8 version, u8 kind, u16 flags, u32 sequence, f64 capture time (ms).
Flags of a view, bit 0: show only what was captured of a person; bit 1: the viewer draws the room,
so send poses instead of pictures; bit 2: pictures have stopped although they are wanted, so send a
key frame; bit 3: sound alone, so send neither pictures nor poses; bit 4: send poses beside
pictures. Unknown bits are ignored.
View, 36 bytes: f32 position[3] (world, m), f32 quaternion wxyz of camera_to_world (OpenCV axes),
f32 vertical field of view (rad), u16 width, u16 height (px).
Keypoints: `services.live.keypoints_packet`. Live look, which comes in order and whole and has a
header of its own: `services.live.look.packets`. Sealed motion:
`services.live.sealed_packet`.
Flags of a pose: how old, ms, the picture of the landmarks that it follows was when they left their
page, at least 1; 0 where it follows none.
Pose, 160 bytes: u8 index of the performer, u8 count of performers, u16 low bits of the
CRC-32 of the performer's id (a viewer whose list differs reads it anew), f32 pelvis[3] (room, m),
then 24 rotations of 6 bytes as `scene.smallest_three` packs them in 15 bits a component: of the
pelvis in the room, of every other joint relative to its parent.
Expression, 18 bytes, may follow a pose: u8 values[17] (1/255) in the order of `scene.expression`,
u8 bits of what is known (`capture.body.expressions`). Where it is left out all is at rest. Earlier
recordings have 16 bytes, without where the eyes look, or 8: a hand's one curl is then that of each
of its fingers.
Batch, to a viewer whose channel `pose` has the protocol `batches`: u8 version, u8 kind, then pose
packets of one tick, each after a u8 of its length. What is sent costs by the message, not by the
byte.

Channels are unordered and unreliable, so the newest sequence wins and late packets are dropped;
sequences wrap and are compared as serial numbers (RFC 1982).
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from capture.body.expressions import ALL_GROUPS
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.errors import SceneError
from scene.expression import EARLIER_COUNTS, EXPRESSION_COUNT, neutral, values_of_any_version
from scene.rotations import quaternion_to_matrix
from scene.skeleton import JOINT_COUNT
from scene.smallest_three import pack_quaternions, unpack_quaternions

VERSION = 1
HEADER = struct.Struct("<BBHId")
_VIEW = struct.Struct("<3f4ffHH")
VIEW_BYTES = HEADER.size + _VIEW.size
_HALF_RANGE = 1 << 31
_HIDE_UNSEEN, _DRAWS_ITSELF, _STALLED, _SOUND_ONLY, _POSES_TOO = 1, 2, 4, 8, 16
_POSE = struct.Struct("<BBH3f")
_ROTATION_BITS, _ROTATION_BYTES = 15, 6
POSE_BYTES = HEADER.size + _POSE.size + JOINT_COUNT * _ROTATION_BYTES
EXPRESSION_BYTES = EXPRESSION_COUNT + 1
_POSE_SIZES = tuple(
    POSE_BYTES + more for more in (0, *(n + 1 for n in EARLIER_COUNTS), EXPRESSION_BYTES)
)

BATCHES = "batches"
"""Protocol of a channel `pose` whose viewer takes batches."""
LONGEST_BATCH = 1200
"""Bytes of one SCTP chunk, which a longer message would be cut into."""


class Kind(IntEnum):
    """What a packet carries."""

    KEYPOINTS = 1
    POSE = 2
    VIEW = 3
    LOOK_FRAME = 4
    LOOK_POSE = 5
    LOOK_END = 6
    BATCH = 7
    MOTION = 8
    BODY = 9
    SEALED_MOTION = 10
    SEALED_BATCH = 11


_BATCH_HEAD = bytes([VERSION, Kind.BATCH])


class PacketError(SceneError):
    """Bytes that are not a packet of ours."""


@dataclass(frozen=True)
class ViewPacket:
    """Where a viewer stands and how many pixels they look at."""

    sequence: int
    capture_time_ms: float
    position: tuple[float, float, float]
    """World, m."""
    wxyz: tuple[float, float, float, float]
    """Quaternion of camera_to_world, OpenCV axes."""
    fov_y_rad: float
    width: int
    height: int
    hide_unseen: bool = False
    """Whether what was never captured of a person, and is a guess, fades out."""
    draws_itself: bool = False
    """Whether the viewer draws the room, needs poses and no pictures."""
    stalled: bool = False
    """Whether pictures are wanted and none has been shown for a while."""
    sound_only: bool = False
    """Whether the viewer's connection is too slow for pictures, and for poses."""
    poses_too: bool = False
    """Whether the viewer needs poses, whoever draws the room: for a picture of themselves."""

    def camera(self, width: int, height: int) -> Camera:
        """The viewer's camera at `width` x `height` px.

        Raises InvalidInput where the field of view is impossible.
        """
        camera_to_world = quaternion_to_matrix(np.array(self.wxyz))
        translation = -camera_to_world.T @ np.array(self.position)
        world_to_camera = np.concatenate([camera_to_world.T, translation[:, None]], axis=1)
        return Camera.from_field_of_view(world_to_camera, width, height, self.fov_y_rad)


@dataclass(frozen=True, eq=False)
class PosePacket:
    """The pose of one performer in the room now."""

    sequence: int
    capture_time_ms: float
    """Of the pose, on the server's clock."""
    index: int
    """Of the performer among those of the room."""
    count: int
    """Of performers in the room."""
    check: int
    """Of the performer's id; see `performer_check`."""
    pelvis: Float[Array, "3"]
    """Room, m."""
    rotations: Float[Array, "24 4"]
    """Quaternions wxyz: of the pelvis in the room, of every other joint relative to its parent."""
    landmarks_age_ms: int = 0
    """How old the picture of the landmarks was when they left their page; 0: there are none."""
    expression: Float[Array, "E"] = field(default_factory=neutral)
    """Of `scene.expression.EXPRESSION_NAMES`, 0 to 1."""


def performer_check(performer_id: str) -> int:
    """16 bits by which a viewer checks that an index means the performer it expects."""
    return zlib.crc32(performer_id.encode()) & 0xFFFF


def header_of(
    data: bytes, wanted: Kind, sizes: Sequence[int], version: int = VERSION
) -> tuple[int, int, float]:
    """Flags, sequence and capture time (ms) of a packet of the kind `wanted`, of one of `sizes`.

    Raises PacketError where it is another.
    """
    name = f"a {wanted.name.lower()} packet"
    if len(data) not in sizes:
        allowed = " or ".join(str(one) for one in sizes)
        raise PacketError(f"{name} must be {allowed} bytes long; got {len(data)}")
    got_version, kind, flags, sequence, capture_time_ms = HEADER.unpack_from(data)
    if got_version != version or kind != wanted:
        raise PacketError(
            f"{name} must be version {version}, kind {int(wanted)}; "
            f"got version {got_version}, kind {kind}"
        )
    return flags, sequence, capture_time_ms


def encode_view(packet: ViewPacket) -> bytes:
    """The bytes of `packet`."""
    flags = _HIDE_UNSEEN * packet.hide_unseen | _DRAWS_ITSELF * packet.draws_itself
    flags |= _STALLED * packet.stalled | _SOUND_ONLY * packet.sound_only
    flags |= _POSES_TOO * packet.poses_too
    header = HEADER.pack(VERSION, Kind.VIEW, flags, packet.sequence, packet.capture_time_ms)
    payload = _VIEW.pack(
        *packet.position, *packet.wxyz, packet.fov_y_rad, packet.width, packet.height
    )
    return header + payload


def decode_view(data: bytes) -> ViewPacket:
    """Read a view packet. Raises PacketError with the rule that `data` breaks."""
    flags, sequence, capture_time_ms = header_of(data, Kind.VIEW, (VIEW_BYTES,))
    x, y, z, *wxyz, fov_y_rad, width, height = _VIEW.unpack_from(data, HEADER.size)
    if not all(math.isfinite(v) for v in (x, y, z, *wxyz, fov_y_rad, capture_time_ms)):
        raise PacketError(f"a view packet must hold finite numbers; got {(x, y, z, *wxyz)}")
    length = math.sqrt(sum(v * v for v in wxyz))
    if not 0.5 < length < 2.0:
        raise PacketError(f"quaternion must have about unit length; got {length:.3g}")
    return ViewPacket(
        sequence,
        capture_time_ms,
        (x, y, z),
        tuple(wxyz),
        fov_y_rad,
        width,
        height,
        bool(flags & _HIDE_UNSEEN),
        bool(flags & _DRAWS_ITSELF),
        bool(flags & _STALLED),
        bool(flags & _SOUND_ONLY),
        bool(flags & _POSES_TOO),
    )


def encode_pose(packet: PosePacket) -> bytes:
    """The bytes of `packet`."""
    return encode_poses([packet])[0]


def encode_poses(packets: Sequence[PosePacket]) -> list[bytes]:
    """The bytes of each of `packets`; of many at once that takes less time for each."""
    if not packets:
        return []
    rotations = np.stack([packet.rotations for packet in packets])
    packed = pack_quaternions(rotations, _ROTATION_BITS).astype("<u8").view(np.uint8)
    packed = packed.reshape(len(packets), JOINT_COUNT, 8)[:, :, :_ROTATION_BYTES]
    return [
        HEADER.pack(VERSION, Kind.POSE, one.landmarks_age_ms, one.sequence, one.capture_time_ms)
        + _POSE.pack(one.index, one.count, one.check, *one.pelvis)
        + turns.tobytes()
        + _expression_bytes(one.expression)
        for one, turns in zip(packets, packed, strict=True)
    ]


def _expression_bytes(expression: Float[Array, "E"]) -> bytes:
    if not expression.any():
        return b""
    levels = np.rint(255.0 * np.clip(expression, 0.0, 1.0)).astype(np.uint8)
    return levels.tobytes() + bytes([ALL_GROUPS])


def batches_of(packets: Iterable[bytes]) -> list[bytes]:
    """The pose packets of one tick in as few messages as fit into a packet of the network each."""
    batches = [_BATCH_HEAD]
    for packet in packets:
        if len(batches[-1]) + 1 + len(packet) > LONGEST_BATCH:
            batches.append(_BATCH_HEAD)
        batches[-1] += bytes([len(packet)]) + packet
    return batches if len(batches[0]) > len(_BATCH_HEAD) else []


def packets_of(message: bytes) -> Iterator[bytes]:
    """The pose packets in a message of a channel `pose`: those of a batch, or the one it is.

    What is cut off short is left out.
    """
    if not message.startswith(_BATCH_HEAD):
        yield message
        return
    at = len(_BATCH_HEAD)
    while at < len(message) and at + 1 + message[at] <= len(message):
        yield message[at + 1 : at + 1 + message[at]]
        at += 1 + message[at]


def decode_pose(data: bytes) -> PosePacket:
    """Read a pose packet. Raises PacketError with the rule that `data` breaks."""
    age_ms, sequence, capture_time_ms = header_of(data, Kind.POSE, _POSE_SIZES)
    index, count, check, *pelvis = _POSE.unpack_from(data, HEADER.size)
    if not all(math.isfinite(v) for v in (capture_time_ms, *pelvis)):
        raise PacketError(f"a pose packet must hold finite numbers; got {pelvis}")
    packed = np.zeros((JOINT_COUNT, 8), np.uint8)
    offset = HEADER.size + _POSE.size
    packed[:, :_ROTATION_BYTES] = np.frombuffer(
        data, np.uint8, JOINT_COUNT * _ROTATION_BYTES, offset
    ).reshape(JOINT_COUNT, _ROTATION_BYTES)
    rotations = unpack_quaternions(packed.view("<u8")[:, 0].astype(np.int64), _ROTATION_BITS)
    levels = np.frombuffer(data[POSE_BYTES:-1], np.uint8) / 255.0
    return PosePacket(
        sequence,
        capture_time_ms,
        index,
        count,
        check,
        np.array(pelvis),
        rotations,
        age_ms,
        values_of_any_version(levels) if len(levels) else neutral(),
    )


def is_newer(sequence: int, than: int) -> bool:
    """Whether `sequence` comes after `than`, across the wrap at 2^32 (RFC 1982)."""
    return 0 < (sequence - than) % (1 << 32) < _HALF_RANGE


class NewestView:
    """Keeps the newest view packet; late and duplicate ones change nothing."""

    def __init__(self) -> None:
        self.packet: ViewPacket | None = None

    def receive(self, packet: ViewPacket) -> bool:
        """Take `packet` if it is the newest so far; says whether it was."""
        if self.packet is not None and not is_newer(packet.sequence, self.packet.sequence):
            return False
        self.packet = packet
        return True

    @property
    def wants_poses(self) -> bool:
        """Whether the viewer draws the room, or themselves."""
        packet = self.packet
        if packet is None or packet.sound_only:
            return False
        return packet.draws_itself or packet.poses_too

    @property
    def draws_room(self) -> bool:
        """Whether the viewer draws the room."""
        packet = self.packet
        return packet is not None and packet.draws_itself and not packet.sound_only

    @property
    def wants_pictures(self) -> bool:
        """Whether the room is to be drawn for the viewer; true until they say otherwise."""
        packet = self.packet
        return packet is None or not (packet.draws_itself or packet.sound_only)
