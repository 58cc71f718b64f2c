"""The packet by which a page learns the body that it solves poses of.

A page asks on its channel `motion` by any text until it gets one, since the channel may lose it.
u8 version, u8 kind, u16 zero, f32 yaw (rad about +y, from facing the camera to facing the front),
then f32 joints at rest [24 3] and landmarks at rest [33 3], m. One packet of the network holds it.
"""

from __future__ import annotations

import struct

import numpy as np

from capture.body.landmarks import landmarks_on
from scene.body import Body
from scene.skeleton import Skeleton
from services.live.packets import VERSION, Kind

_HEAD = struct.Struct("<BBHf")
BODY_BYTES = _HEAD.size + 4 * 3 * (24 + 33)


def encode_body(skeleton: Skeleton, yaw_rad: float) -> bytes:
    """The bytes for a body of `skeleton`, whose owner faces the front once turned by `yaw_rad`."""
    landmarks, _ = landmarks_on(Body(skeleton))
    head = _HEAD.pack(VERSION, Kind.BODY, 0, yaw_rad)
    return head + b"".join(
        np.asarray(one, "<f4").tobytes() for one in (skeleton.rest_joints, landmarks)
    )
