"""What goes between a gateway and its renderers: a header in JSON, and bytes.

A message is u32 length of the header, the header, then the parts whose lengths the header tells.
Only poses, encoded pictures and, once each, models and environments cross; the bytes are a
gateway's own, or of a renderer that it started.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from av import Packet

from scene.camera import Camera
from services.live.streaming.encoding import timed
from services.live.streaming.pictures import CodedPicture, PictureOrder

_LENGTH = struct.Struct("<I")
Header = dict[str, Any]


def pack(header: Header, parts: Sequence[bytes] = ()) -> bytes:
    """The bytes of a message."""
    told = json.dumps(header | {"parts": [len(part) for part in parts]}).encode()
    return b"".join((_LENGTH.pack(len(told)), told, *parts))


def unpack(message: bytes) -> tuple[Header, list[bytes]]:
    """Header and parts of a message."""
    at = _LENGTH.size + _LENGTH.unpack_from(message)[0]
    header, parts = json.loads(message[_LENGTH.size : at]), []
    for length in header["parts"]:
        parts.append(message[at : at + length])
        at += length
    return header, parts


def order_header(order: PictureOrder) -> Header:
    """`order`, for a header."""
    camera = order.camera
    return {
        "tick": order.tick,
        "now_s": order.now_s,
        "size": [camera.width, camera.height],
        "intrinsics": camera.intrinsics.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(),
        "hide_unseen": order.hide_unseen,
        "scale": order.scale,
        "bitrate": order.bitrate,
        "key": order.key,
        "stamp_ms": order.stamp_ms,
    }


def order_of(header: Header) -> PictureOrder:
    """The order that a header tells."""
    intrinsics, world_to_camera = (
        np.array(header[name]) for name in ("intrinsics", "world_to_camera")
    )
    return PictureOrder(
        header["tick"],
        header["now_s"],
        Camera(intrinsics, world_to_camera, *header["size"]),
        header["hide_unseen"],
        header["scale"],
        header["bitrate"],
        header["key"],
        header["stamp_ms"],
    )


def pack_picture(picture: CodedPicture) -> bytes:
    """The answer that is a picture."""
    header = {
        "size": [picture.width, picture.height],
        "draw_s": picture.draw_s,
        "encode_s": picture.encode_s,
        "worked_s": picture.worked_s,
        "key": picture.packet.is_keyframe,
    }
    return pack(header, [bytes(picture.packet)])


def picture_of(header: Header, parts: Sequence[bytes], tick: int) -> CodedPicture:
    """The picture of `tick` that an answer brings."""
    packet = timed(Packet(parts[0]), tick)
    packet.is_keyframe = header["key"]
    width, height = header["size"]
    return CodedPicture(
        packet, width, height, header["draw_s"], header["encode_s"], header["worked_s"]
    )
