"""The packet of the channel `motion`: what a page solved of one picture of a webcam.

Header as in `services.live.packets`, of the kind MOTION; its u16 holds in 15 bits how old the
picture was when the packet left, ms, and in the highest whether live look is on. Then, 278 bytes:

- f32 root[3] (m) and f32 shift of the root in the next 0.15 s[3] (m),
- f32 scale (rad), of the turns below,
- rotations of the 24 joints relative to their parents, 6 bytes each (`scene.smallest_three`, 15
  bits a component): within a hundredth of a degree,
- i8 turns of the joints in the next 0.15 s [24 3], of which 127 are the scale: what moves most is
  predicted within 1/254 of its turn,
- u8 numbers of `scene.expression` [17] (1/255),
- u8 flags: the left foot stands still (1), the right one (2).

While live look is on, 82 bytes more tell where they were in the picture: u16 width, u16 height
(px), f32 root[3] (m), and rotations of `SEEN_JOINTS` as above; all others are as they are shown.

A page may send anything: whatever is no motion of a person is refused before it is followed, and
what is followed moves nobody but their own performer.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from scene.arrays import Array, Float
from scene.camera import Camera
from scene.expression import EXPRESSION_COUNT
from scene.motion import Pose
from scene.rotations import matrix_to_quaternion
from scene.skeleton import JOINT_COUNT, JOINT_NAMES
from scene.smallest_three import pack_quaternions
from services.live.motion.expression_filter import HeldExpression
from services.live.motion.solved_motion import LocalPose, SolvedMotion, SolvedPose, usual_camera
from services.live.packets import HEADER, VERSION, Kind, PacketError, header_of

_OLDEST_MS, _LIVE_LOOK = 0x7FFF, 0x8000
_HEAD = struct.Struct("<7f")
_SEEN_HEAD = struct.Struct("<2H3f")
_ROTATION_BITS, _ROTATION_BYTES = 15, 6
_TURN_STEPS = 127
SEEN_JOINTS = [
    JOINT_NAMES.index(name)
    for name in (
        "pelvis",
        *(f"{s}_{part}" for s in ("left", "right") for part in ("hip", "knee", "ankle", "foot")),
        "neck",
        "head",
    )
]
"""Those that stand on the floor and look level where they are shown: before the camera they did
not."""
_ROTATIONS_AT = HEADER.size + _HEAD.size
_TURNS_AT = _ROTATIONS_AT + JOINT_COUNT * _ROTATION_BYTES
_EXPRESSION_AT = _TURNS_AT + 3 * JOINT_COUNT
MOTION_BYTES = _EXPRESSION_AT + EXPRESSION_COUNT + 1
_SEEN_ROTATIONS_AT = MOTION_BYTES + _SEEN_HEAD.size
LONGEST_MOTION_BYTES = _SEEN_ROTATIONS_AT + len(SEEN_JOINTS) * _ROTATION_BYTES
"""While live look is on."""
_FARTHEST_M = 3.0
"""Of a root from where its performer stands, and of what it moves by at a time."""
_FARTHEST_SEEN_M = 100.0
_FASTEST_M_S = 20.0
"""Of a root from one picture to the next: a solver that finds somebody again jumps as fast."""
_LARGEST_TURN_RAD = 3.15
_LATEST_MS = float(1 << 53)
"""Whole ms are exact until then."""


@dataclass(frozen=True, eq=False)
class MotionPacket:
    """What a page solved, as it travels."""

    sequence: int
    motion: SolvedMotion
    live_look: bool = False
    """Whether pictures of the person travel with it (`services.live.look`)."""


def encode_motion(packet: MotionPacket) -> bytes:
    """The bytes of `packet`, whose motion tells where they were in the picture if live look is on.

    What is out of range is moved to the range's end.
    """
    motion, look = packet.motion, packet.live_look
    told = min(max(motion.age_ms, 0), _OLDEST_MS) | _LIVE_LOOK * look
    scale = float(np.float32(np.abs(motion.ahead).max()))
    turns = np.floor(_TURN_STEPS * motion.ahead / (scale or 1.0) + 0.5).clip(-127, 127)
    expression = motion.expression.at(motion.time_s)
    left, right = motion.feet_locked
    parts = [
        HEADER.pack(VERSION, Kind.MOTION, told, packet.sequence, motion.captured_ms),
        _HEAD.pack(*motion.now.root, *motion.ahead_m, scale),
        _packed(motion.now.local),
        turns.astype(np.int8).tobytes(),
        np.floor(255.0 * expression.clip(0.0, 1.0) + 0.5).astype(np.uint8).tobytes(),
        bytes([left | right << 1]),
    ]
    if look:
        assert motion.seen is not None
        pose, camera = motion.seen.pose, motion.seen.camera
        parts += [
            _SEEN_HEAD.pack(camera.width, camera.height, *pose.root_translation),
            _packed(_matrices(pose.joint_angles[SEEN_JOINTS])),
        ]
    return b"".join(parts)


def decode_motion(data: bytes) -> MotionPacket:
    """Read a motion packet. Raises PacketError with the rule that `data` breaks."""
    sizes = (MOTION_BYTES, LONGEST_MOTION_BYTES)
    told, sequence, captured_ms = header_of(data, Kind.MOTION, sizes)
    if not 0.0 <= captured_ms <= _LATEST_MS:
        raise PacketError(f"capture time must be from 0 to 2^53 ms; got {captured_ms}")
    x, y, z, ahead_x, ahead_y, ahead_z, scale = _HEAD.unpack_from(data, HEADER.size)
    for name, values in (("root", (x, y, z)), ("shift", (ahead_x, ahead_y, ahead_z))):
        if not all(abs(value) <= _FARTHEST_M for value in values):
            raise PacketError(f"{name} must be within {_FARTHEST_M:g} m; got {values}")
    if not 0.0 <= scale <= _LARGEST_TURN_RAD:
        raise PacketError(f"joints must turn by at most {_LARGEST_TURN_RAD} rad; got {scale}")
    local = _rotations(data, _ROTATIONS_AT, JOINT_COUNT)
    turns = np.frombuffer(data, np.int8, 3 * JOINT_COUNT, _TURNS_AT).reshape(-1, 3)
    levels = np.frombuffer(data, np.uint8, EXPRESSION_COUNT, _EXPRESSION_AT)
    look = bool(told & _LIVE_LOOK)
    if look != (len(data) == LONGEST_MOTION_BYTES):
        raise PacketError(
            f"a motion packet must be {LONGEST_MOTION_BYTES} bytes long while live look is on, "
            f"else {MOTION_BYTES}; got {len(data)}"
        )
    flags = data[MOTION_BYTES - 1]
    motion = SolvedMotion(
        captured_ms,
        LocalPose(local, np.array([x, y, z])),
        turns * (scale / _TURN_STEPS),
        np.array([ahead_x, ahead_y, ahead_z]),
        (bool(flags & 1), bool(flags & 2)),
        HeldExpression(levels / 255.0, np.full(EXPRESSION_COUNT, captured_ms / 1e3)),
        told & _OLDEST_MS,
        None,
    )
    return MotionPacket(sequence, _with_seen(motion, data) if look else motion, look)


def require_plausible(motion: SolvedMotion, last: SolvedMotion | None) -> None:
    """Raises PacketError where the root has gone faster since `last` than anybody does."""
    if last is None:
        return
    step_s = motion.time_s - last.time_s
    if not step_s > 0.0:
        raise PacketError(f"capture time must be later than {last.time_s}; got {motion.time_s}")
    gone_m = math.dist(motion.now.root.tolist(), last.now.root.tolist())
    if gone_m > _FASTEST_M_S * step_s:
        raise PacketError(
            f"a root must move by at most {_FASTEST_M_S:g} m/s; got {gone_m / step_s:.0f}"
        )


def _with_seen(motion: SolvedMotion, data: bytes) -> SolvedMotion:
    width, height, *root = _SEEN_HEAD.unpack_from(data, MOTION_BYTES)
    if not (width and height):
        raise PacketError(f"a picture must have some size; got {width} x {height}")
    if not all(abs(value) <= _FARTHEST_SEEN_M for value in root):
        raise PacketError(
            f"somebody must be within {_FARTHEST_SEEN_M:g} m of their camera; got {root}"
        )
    local = motion.now.local.copy()
    local[SEEN_JOINTS] = _rotations(data, _SEEN_ROTATIONS_AT, len(SEEN_JOINTS))
    expression = motion.expression.values
    pose = Pose(_angles(local), np.array(root), motion.time_s, expression)
    return replace(motion, seen=SolvedPose(motion.captured_ms, pose, _camera(width, height)))


def _angles(rotations: Float[Array, "J 3 3"]) -> Float[Array, "J 3"]:
    from scene.kinematics_kernels import matrices_to_axis_angles

    return matrices_to_axis_angles(rotations)


@lru_cache(maxsize=64)
def _camera(width: int, height: int) -> Camera:
    return usual_camera(width, height)


def _rotations(data: bytes, at: int, count: int) -> Float[Array, "J 3 3"]:
    """Raises PacketError for what is no rotation."""
    from services.live.motion.motion_packet_kernels import unpack_rotations

    rotations = np.empty((count, 3, 3))
    packed = np.frombuffer(data, np.uint8, count * _ROTATION_BYTES, at)
    if not unpack_rotations(packed, rotations):
        raise PacketError(
            "rotations must be unit quaternions without their largest component; got one that is "
            "longer; pack them as scene.smallest_three does"
        )
    return rotations


def _packed(rotations: Float[Array, "J 3 3"]) -> bytes:
    packed = pack_quaternions(matrix_to_quaternion(rotations), _ROTATION_BITS).astype("<u8")
    return packed.view(np.uint8).reshape(-1, 8)[:, :_ROTATION_BYTES].tobytes()


def _matrices(angles: Float[Array, "J 3"]) -> Float[Array, "J 3 3"]:
    from scene.kinematics_kernels import axis_angles_to_matrices

    return axis_angles_to_matrices(angles)
