"""Keypoints packets: golden bytes, round trips, every way to be wrong."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.body.expressions import (
    ALL_GROUPS,
    FACE,
    LEFT_HAND,
    RIGHT_HAND,
    ObservedExpression,
)
from capture.body.landmark_names import LANDMARK_COUNT
from scene.expression import neutral
from services.live import packets
from services.live.packets import (
    EXPRESSION_BYTES,
    KEYPOINTS_BYTES,
    KeypointsPacket,
    PacketError,
    decode_keypoints,
    encode_keypoints,
)

GOLDEN = (
    "01010000"
    "07000000"
    "0000000000709740"  # version 1, kind 1, flags, sequence, 1500.0
    "8002"
    "e001"  # 640 x 480
    + "001000f8"
    + "00000000" * 31
    + "00200030"  # xy
    + "000400f00020"
    + "000000000000" * 31
    + "00e0000800fe"  # xyz
    + "ff"
    + "00" * 31
    + "33"  # visibility
)


def packet(sequence: int = 7, capture_time_ms: float = 1500.0) -> KeypointsPacket:
    xy, world, visibility = np.zeros((33, 2)), np.zeros((33, 3)), np.zeros(33)
    xy[[0, 32]] = [0.5, -0.25], [1.0, 1.5]
    world[[0, 32]] = [0.125, -0.5, 1.0], [-1.0, 0.25, -0.0625]
    visibility[[0, 32]] = 1.0, 0.2
    return KeypointsPacket(sequence, capture_time_ms, 640, 480, xy, world, visibility)


def test_golden_bytes():
    data = encode_keypoints(packet())
    assert data.hex() == GOLDEN
    assert len(data) == KEYPOINTS_BYTES <= 404
    assert packets.LANDMARK_COUNT == LANDMARK_COUNT


def test_golden_bytes_of_an_expression():
    """The page's tests hold its encoder to the same."""
    values = np.array([0.2, 1.0, 0.0, 0.4, 2.0, -1.0, 0.6, *[0.0] * 9, 0.8])
    seen = ObservedExpression(values, FACE | LEFT_HAND)
    data = encode_keypoints(replace(packet(), expression=seen))
    assert data.hex() == GOLDEN + "33ff0066ff0099" + 9 * "00" + "cc03"
    assert len(data) == KEYPOINTS_BYTES + EXPRESSION_BYTES
    back = decode_keypoints(data).expression
    assert back is not None
    assert back.known == FACE | LEFT_HAND
    np.testing.assert_allclose(back.values, np.clip(values, 0.0, 1.0), atol=0.5 / 255)
    assert decode_keypoints(bytes.fromhex(GOLDEN)).expression is None


def test_an_earlier_pages_hand_closes_all_its_fingers():
    back = decode_keypoints(bytes.fromhex(GOLDEN + "33ff0066ff0099" + "05")).expression
    assert back is not None
    assert back.known == FACE | RIGHT_HAND
    wanted = [0.2, 1.0, 0.0, 0.4, 1.0, *[0.0] * 7, *[0.6] * 5]
    np.testing.assert_allclose(back.values, wanted, atol=1e-9)


def test_eyes_of_an_earlier_page_look_straight_ahead():
    data = bytes.fromhex(GOLDEN + "33ff0066ff" + "99" + 9 * "00" + "03")
    back = decode_keypoints(data).expression
    assert back is not None
    wanted = [0.2, 1.0, 0.0, 0.4, 1.0, *[0.0] * 2, 0.6, *[0.0] * 9]
    np.testing.assert_allclose(back.values, wanted, atol=1e-9)


def test_groups_that_nobody_knows_of_are_left_alone():
    data = encode_keypoints(replace(packet(), expression=ObservedExpression(neutral(), 0xFF)))
    back = decode_keypoints(data).expression
    assert back is not None
    assert back.known == ALL_GROUPS
    assert back.known_numbers.all()


@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(1, 65535), st.integers(1, 65535)),
    st.lists(st.integers(-32768, 32767), min_size=165, max_size=165),
    st.lists(st.integers(0, 255), min_size=33, max_size=33),
)
def test_round_trips(sequence, size, places, seen):
    steps = np.array(places) / 8192.0
    xy, world = steps[:66].reshape(33, 2), steps[66:].reshape(33, 3)
    one = KeypointsPacket(sequence, 12.5, size[0], size[1], xy, world, np.array(seen) / 255.0)
    back = decode_keypoints(encode_keypoints(one))
    assert (back.sequence, back.capture_time_ms, back.width, back.height) == (sequence, 12.5, *size)
    for name in ("xy", "world", "visibility"):
        np.testing.assert_array_equal(getattr(back, name), getattr(one, name))


def test_what_is_out_of_range_is_moved_to_its_end():
    far = packet()
    far.xy[5], far.world[5], far.visibility[5] = 9.0, -9.0, 2.0
    back = decode_keypoints(encode_keypoints(far))
    assert back.xy[5, 0] == 32767 / 8192
    assert back.world[5, 0] == -4.0
    assert back.visibility[5] == 1.0


def test_every_truncation_is_refused():
    data = encode_keypoints(packet())
    for length in [*range(len(data)), len(data) + 1]:
        with pytest.raises(
            PacketError, match=f"must be 383 or 391 or 399 or 401 bytes long; got {length}"
        ):
            decode_keypoints((data + b"x")[:length])


@pytest.mark.parametrize(
    ("offset", "form", "value", "words"),
    [
        (0, "<B", 9, "version 1, kind 1; got version 9, kind 1"),
        (1, "<B", 3, "version 1, kind 1; got version 1, kind 3"),
        (8, "<d", float("nan"), "finite capture time .* got nan, 640 x 480"),
        (16, "<H", 0, "picture of some size; got 1500.0, 0 x 480"),
        (18, "<H", 0, "picture of some size; got 1500.0, 640 x 0"),
    ],
)
def test_packets_that_are_none_are_refused_in_words(offset, form, value, words):
    data = bytearray(encode_keypoints(packet()))
    struct.pack_into(form, data, offset, value)
    with pytest.raises(PacketError, match=words):
        decode_keypoints(bytes(data))


@given(st.binary(min_size=363, max_size=363))
def test_any_landmarks_are_finite(body):
    read = decode_keypoints(bytes.fromhex(GOLDEN[:40]) + body)
    for values in (read.xy, read.world, read.visibility):
        assert np.isfinite(values).all()
