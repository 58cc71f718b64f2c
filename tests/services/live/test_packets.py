"""View packets: golden bytes, round trips, every way to be wrong, and newest wins."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene import look_at
from scene.rotations import matrix_to_quaternion
from services.live.packets import (
    VIEW_BYTES,
    NewestView,
    PacketError,
    ViewPacket,
    decode_view,
    encode_view,
    is_newer,
)

PACKET = ViewPacket(7, 1500.0, (1.0, 1.5, 3.0), (1.0, 0.0, 0.0, 0.0), 0.5, 512, 384)
GOLDEN = (
    "01030000"
    "07000000"
    "0000000000709740"  # version 1, kind 3, flags, sequence, 1500.0
    "0000803f"
    "0000c03f"
    "00004040"  # position
    "0000803f"
    "00000000"
    "00000000"
    "00000000"  # wxyz
    "0000003f"
    "0002"
    "8001"  # field of view, 512 x 384
)


def test_golden_bytes():
    assert encode_view(PACKET).hex() == GOLDEN
    assert len(encode_view(PACKET)) == VIEW_BYTES == 52


def test_only_what_was_filmed_is_the_first_flag():
    data = bytearray.fromhex(GOLDEN)
    assert not decode_view(bytes(data)).hide_unseen
    data[2] = 1
    assert decode_view(bytes(data)).hide_unseen
    data[2] = 4
    assert decode_view(bytes(data)).stalled
    data[2] = 0xF0  # flags of a later version
    assert not decode_view(bytes(data)).stalled
    assert not decode_view(bytes(data)).hide_unseen


@given(
    st.integers(0, 2**32 - 1),
    st.tuples(*[st.floats(-50, 50, width=32)] * 3),
    st.integers(0, 65535),
    st.booleans(),
)
def test_round_trips(sequence, position, width, hide):
    packet = ViewPacket(sequence, 12.5, position, (0.5, 0.5, 0.5, 0.5), 0.75, width, 480, hide)
    assert decode_view(encode_view(packet)) == packet


def test_every_truncation_is_refused():
    data = encode_view(PACKET)
    for length in range(len(data)):
        with pytest.raises(PacketError, match=f"must be 52 bytes long; got {length}"):
            decode_view(data[:length])


def test_other_versions_and_kinds_are_refused():
    data = bytearray(encode_view(PACKET))
    data[0] = 9
    with pytest.raises(PacketError, match="version 1, kind 3; got version 9, kind 3"):
        decode_view(bytes(data))


@pytest.mark.parametrize("offset", [16, 20, 24, 28, 44])
def test_nan_is_refused(offset):
    data = bytearray(encode_view(PACKET))
    struct.pack_into("<f", data, offset, float("nan"))
    with pytest.raises(PacketError, match="finite numbers"):
        decode_view(bytes(data))


def test_a_nil_quaternion_is_refused():
    data = bytearray(encode_view(PACKET))
    struct.pack_into("<4f", data, 28, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(PacketError, match="unit length; got 0"):
        decode_view(bytes(data))


def test_camera_stands_where_the_viewer_does():
    world_to_camera = look_at((1.0, 1.5, 3.0), (0.0, 1.0, 0.0))
    wxyz = tuple(matrix_to_quaternion(world_to_camera[:, :3].T.copy()))
    camera = ViewPacket(0, 0.0, (1.0, 1.5, 3.0), wxyz, 0.6, 0, 0).camera(640, 480)
    np.testing.assert_allclose(camera.world_to_camera, world_to_camera, atol=1e-12)
    assert (camera.width, camera.height) == (640, 480)


@given(st.integers(0, 2**32 - 1), st.integers(1, 2**31 - 1))
def test_newer_holds_across_the_wrap(start, ahead):
    later = (start + ahead) % 2**32
    assert is_newer(later, start)
    assert not is_newer(start, later)
    assert not is_newer(start, start)


def test_late_and_doubled_packets_change_nothing():
    newest = NewestView()
    late = ViewPacket(6, 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.5, 64, 64)
    assert newest.receive(PACKET)
    assert not newest.receive(PACKET)
    assert not newest.receive(late)
    assert newest.packet is PACKET


def test_drawing_for_oneself_is_the_second_flag():
    data = bytearray.fromhex(GOLDEN)
    data[2] = 2
    packet = decode_view(bytes(data))
    assert packet.draws_itself
    assert not packet.hide_unseen
    assert encode_view(packet) == bytes(data)


@pytest.mark.parametrize(
    ("flags", "pictures", "poses"),
    [
        (0, True, False),
        (2, False, True),
        (8, False, False),
        (10, False, False),
        (16, True, True),
        (24, False, False),
    ],
)
def test_sound_alone_is_the_fourth_flag_and_wants_neither_pictures_nor_poses(
    flags, pictures, poses
):
    newest = NewestView()
    assert (newest.wants_pictures, newest.wants_poses) == (True, False)
    data = bytearray.fromhex(GOLDEN)
    data[2] = flags
    packet = decode_view(bytes(data))
    assert packet.sound_only == bool(flags & 8)
    assert encode_view(packet) == bytes(data)
    newest.receive(packet)
    assert (newest.wants_pictures, newest.wants_poses) == (pictures, poses)
