"""Packets of the data channel `look`, which is ordered and reliable: little endian, versioned.

Header, 12 bytes: u8 version, u8 kind (`services.live.packets.Kind`), u8 index of the performer, u8
count of performers, u16 check of the performer's id, u16 flags, u32 number of the frame.
Frame: the bytes of one VP8 frame as its sender encoded it. Flags, bit 0: it is a key frame.
Pose: f32 fx, fy, cx, cy (px) of the picture of the frame of this number, then a pose packet in the
webcam's own world: x to the right, y up, and the webcam, at the origin, looks along -z. The pose's
capture time is the moment of the picture, by the clock of the channel `pose`.
End: the performer has live look no longer; nothing follows, and their colours are gone at once.
client/src/recolouring/packets.ts reads them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from scene.rotations import axis_angle_to_matrix, matrix_to_quaternion
from services.live.look.picture import AlignedPose
from services.live.packets import VERSION, Kind, PosePacket, encode_pose

HEADER = struct.Struct("<BBBBHHI")
_LENS = struct.Struct("<4f")
_KEY_FRAME = 1


@dataclass(frozen=True)
class Whose:
    """Which performer of a room a packet is about; as in `PosePacket`."""

    index: int
    count: int
    check: int


def is_key_frame(data: bytes) -> bool:
    """Whether a VP8 frame needs none before it (RFC 6386, section 9.1)."""
    return bool(data) and not data[0] & 1


def encode_frame(whose: Whose, number: int, data: bytes) -> bytes:
    """The packet of a frame."""
    return _header(Kind.LOOK_FRAME, whose, number, _KEY_FRAME * is_key_frame(data)) + data


def encode_aligned_pose(whose: Whose, number: int, aligned: AlignedPose) -> bytes:
    """The packet of the pose that the picture in the frame of this number shows."""
    pose, k = aligned.pose, aligned.camera.intrinsics
    packet = PosePacket(
        number,
        1e3 * aligned.moment_s,
        whose.index,
        whose.count,
        whose.check,
        aligned.pelvis,
        matrix_to_quaternion(axis_angle_to_matrix(pose.joint_angles)),
        expression=pose.expression,
    )
    lens = _LENS.pack(k[0, 0], k[1, 1], k[0, 2], k[1, 2])
    return _header(Kind.LOOK_POSE, whose, number) + lens + encode_pose(packet)


def encode_end(whose: Whose) -> bytes:
    """The packet that ends a performer's live look."""
    return _header(Kind.LOOK_END, whose, 0)


def _header(kind: Kind, whose: Whose, number: int, flags: int = 0) -> bytes:
    return HEADER.pack(VERSION, kind, whose.index, whose.count, whose.check, flags, number)
