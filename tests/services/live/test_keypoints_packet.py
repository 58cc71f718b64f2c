"""Keypoints packets: golden bytes, round trips, every way to be wrong."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from capture.body.expressions import (
    ALL_GROUPS,
    FACE,
    LEFT_HAND,
    ObservedExpression,
)
from capture.body.landmark_names import LANDMARK_COUNT
from scene.expression import neutral
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from services.live.keypoints_packet import (
    ANCHORS,
    BODY,
    DETAILS,
    EXPRESSION_KEYPOINTS_BYTES,
    KEYPOINTS_BYTES,
    LONGEST_KEYPOINTS_BYTES,
    KeypointsPacket,
    decode_keypoints,
    encode_keypoints,
)
from services.live.packets import PacketError
from tests.capture.people import standing
from tests.services.live.people import seen

GOLDEN = (
    "02014800"
    "07000000"
    "0000000000709740"  # version 2, kind 1, age, sequence, 1500.0
    "8002e001"  # 640 x 480
    "000c0018"  # the middle, 0.375 and 0.75
    "00180018"
    "00300018"  # scales
    "2aabfc050408002000800000020008002000800000020008002000d5fcabac42f5dfbf7ffffefdfb"
    "f7efdfbf7ffffefdfb0780aaba7ffffefdfbf7efdfbf7ffffefdfbf7efdfbf7fff2aadd22aadd22a"
    "add22aadd22aadd2beeffbbeeffbbeeffbbe4fcc35400334bad2e84aa32b8dae34bad2e84aa32b8d"
    "ae34bad2e8eafbbeeffbbeeff32b91fb44bf12bfeffbbeeffbbeeffb0e0000000000000000000000"
    "04"
)
"""What clients write that are no pages of ours."""
LENGTHS = (KEYPOINTS_BYTES, EXPRESSION_KEYPOINTS_BYTES, LONGEST_KEYPOINTS_BYTES)
GOLDEN_EXPRESSION = "d4fc40f60326000000000000200f"
GOLDEN_HEAD = "23aa7424"


def packet(sequence: int = 7, capture_time_ms: float = 1500.0) -> KeypointsPacket:
    xy, world, visibility = np.zeros((33, 2)), np.zeros((33, 3)), np.zeros(33)
    xy[[0, 11, 28, 31]] = [0.5, 0.25], [0.75, 0.375], [0.25, 1.5], [0.125, 1.25]
    world[[0, 16, 20]] = [0.125, -0.5, 0.25], [-0.75, 0.25, -0.0625], [-0.8125, 0.25, 0.0]
    visibility[[0, 32]] = 1.0, 0.25
    return KeypointsPacket(sequence, capture_time_ms, 640, 480, xy, world, visibility, age_ms=72)


def test_golden_bytes():
    data = encode_keypoints(packet())
    assert data.hex() == GOLDEN
    assert len(data) == KEYPOINTS_BYTES
    with_and_without_a_head = EXPRESSION_KEYPOINTS_BYTES + LONGEST_KEYPOINTS_BYTES
    assert 8 * 15 * with_and_without_a_head <= 50_000, "bits a second"
    assert sorted([*BODY, *DETAILS]) == list(range(LANDMARK_COUNT))


def test_golden_bytes_of_an_expression():
    values = np.array([0.2, 1.0, 0.0, 0.4, 2.0, -1.0, 0.6, *[0.0] * 9, 0.8])
    observed = ObservedExpression(values, FACE | LEFT_HAND)
    data = encode_keypoints(replace(packet(), expression=observed))
    assert data.hex() == GOLDEN[:-2] + GOLDEN_EXPRESSION
    assert len(data) == EXPRESSION_KEYPOINTS_BYTES
    assert decode_keypoints(data).head is None
    back = decode_keypoints(data).expression
    assert back is not None
    assert back.known == FACE | LEFT_HAND
    np.testing.assert_allclose(back.values, np.clip(values, 0.0, 1.0), atol=0.5 / 63)
    assert decode_keypoints(bytes.fromhex(GOLDEN)).expression is None


def test_golden_bytes_of_a_head():
    head = axis_angle_to_matrix(np.array([0.1, -0.6, 0.2]))
    told = replace(packet(), expression=ObservedExpression(neutral(), FACE), head=head)
    data = encode_keypoints(told)
    assert data[-4:].hex() == GOLDEN_HEAD
    assert len(data) == LONGEST_KEYPOINTS_BYTES
    back = decode_keypoints(data).head
    assert back is not None
    assert np.linalg.norm(matrix_to_axis_angle(head.T @ back)) < np.radians(0.2)
    # a head is of a face: without one nothing of it travels
    assert len(encode_keypoints(replace(told, expression=None))) == KEYPOINTS_BYTES


def test_groups_that_nobody_knows_of_are_left_alone():
    data = encode_keypoints(replace(packet(), expression=ObservedExpression(neutral(), 0xFF)))
    back = decode_keypoints(data).expression
    assert back is not None
    assert back.known == ALL_GROUPS
    assert back.known_numbers.all()


@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(1, 65535), st.integers(1, 65535)),
    arrays(np.float64, (33, 5), elements=st.floats(-3.0, 3.0)),
    arrays(np.float64, 33, elements=st.floats(0.0, 1.0)),
    st.booleans(),
)
def test_what_comes_back_is_as_near_as_its_bits_allow(sequence, size, places, visibility, look):
    xy, world = places[:, :2], places[:, 2:]
    one = KeypointsPacket(
        sequence, 12.5, size[0], size[1], xy, world, visibility, age_ms=7, live_look=look
    )
    back = decode_keypoints(encode_keypoints(one))
    told = back.sequence, back.capture_time_ms, back.width, back.height, back.age_ms
    assert told == (sequence, 12.5, *size, 7)
    assert back.live_look is look
    np.testing.assert_allclose(back.visibility, visibility, atol=0.5 / 7 + 1e-9)
    for sent, read in ((xy, back.xy), (world, back.world)):
        step = 2.0 / 8192
        body = (np.ptp(sent[BODY], axis=0).max() if sent is xy else np.abs(sent[BODY]).max()) / 255
        detail = np.abs(sent[DETAILS] - sent[ANCHORS]).max() / 31
        np.testing.assert_allclose(read[BODY], sent[BODY], atol=0.5 * body + step)
        np.testing.assert_allclose(
            read[DETAILS] - read[ANCHORS], sent[DETAILS] - sent[ANCHORS], atol=0.5 * detail + step
        )


def test_a_person_is_told_to_a_few_millimetres():
    """Two metres tall, ears 15 cm from the nose, and no landmark is further from its truth."""
    one = seen(standing(1).pose(0), 1)
    back = decode_keypoints(encode_keypoints(one))
    off_m = np.linalg.norm(back.world - one.world, axis=1)
    assert off_m[BODY].max() < 0.004
    assert off_m.max() < 0.008
    assert np.abs((back.xy - one.xy) * [640, 480])[BODY].max() < 1.0


def test_what_is_out_of_range_is_moved_to_its_end():
    far = replace(packet(), age_ms=1 << 20)
    far.xy[11], far.world[11], far.visibility[5] = 90.0, -9.0, 2.0
    back = decode_keypoints(encode_keypoints(far))
    np.testing.assert_allclose(back.xy[11], 32767 / 8192 + 65535 / 8192)
    np.testing.assert_allclose(back.world[11], -65535 / 8192)
    assert back.visibility[5] == 1.0
    assert back.age_ms == 32767
    assert not back.live_look


def test_every_truncation_is_refused():
    data = encode_keypoints(packet())
    for length in [*range(len(data)), len(data) + 1]:
        with pytest.raises(
            PacketError, match=f"must be 193 or 206 or 210 bytes long; got {length}"
        ):
            decode_keypoints((data + b"x")[:length])


@pytest.mark.parametrize(
    ("offset", "form", "value", "words"),
    [
        (0, "<B", 1, "version 2, kind 1; got version 1, kind 1"),
        (1, "<B", 3, "version 2, kind 1; got version 2, kind 3"),
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


@given(st.one_of(*(st.binary(min_size=n - 16, max_size=n - 16) for n in LENGTHS)))
def test_any_bytes_are_finite_landmarks_or_refused(body):
    try:
        read = decode_keypoints(bytes.fromhex(GOLDEN[:32]) + body)
    except PacketError as error:
        assert "picture of some size" in str(error)  # noqa: PT017 (most examples raise nothing)
        return
    for values in (read.xy, read.world, read.visibility):
        assert np.isfinite(values).all()
    if read.expression is not None:
        assert ((read.expression.values >= 0.0) & (read.expression.values <= 1.0)).all()
