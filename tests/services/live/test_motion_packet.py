"""Motion packets: golden bytes, round trips, every way to be wrong; and the body that is told."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import Skeleton
from services.live.motion.body_packet import BODY_BYTES, encode_body
from services.live.motion.motion_packet import (
    LONGEST_MOTION_BYTES,
    MOTION_BYTES,
    MotionPacket,
    decode_motion,
    encode_motion,
    require_plausible,
)
from services.live.motion.motion_solver import MotionSolver
from services.live.packets import PacketError
from tools.build_motion_cases import MOTION_CASES, motion_of, packet_of

HEADERS = 97
"""Bytes around each message, as docs/load.md counts them."""
TOLERANCE = 1e-5
"""Of the six digits that are told, and of what a processor's rounding makes of a frame."""


@pytest.fixture(scope="module")
def cases() -> list[dict[str, Any]]:
    """What `tools.build_motion_cases` wrote; the page's solver is held to the same."""
    return json.loads(MOTION_CASES.read_text())["cases"]


@pytest.fixture(scope="module")
def frames(cases) -> list[dict[str, Any]]:
    """Those that tell a motion whole."""
    return [f for case in cases for f in case["frames"] if f["motion"] and f["motion"]["more"]]


@pytest.fixture(scope="module")
def whole(frames) -> bytes:
    return encode_motion(MotionPacket(7, motion_of(frames[0]), live_look=True))


@pytest.fixture(scope="module")
def short(frames) -> bytes:
    return encode_motion(MotionPacket(7, motion_of(frames[0])))


def skeleton_of(case: dict[str, Any]) -> Skeleton:
    return Skeleton(np.array(case["body"]["rest"], np.float32).reshape(-1, 3).astype(np.float64))


def turned_rad(a: np.ndarray, b: np.ndarray) -> float:
    """The largest angle between rotations."""
    step = matrix_to_axis_angle(np.swapaxes(a, -1, -2) @ b)
    return float(np.linalg.norm(step, axis=-1).max())


def test_the_solver_makes_of_the_cases_what_they_say(cases):
    for case in cases:
        solver = MotionSolver(skeleton_of(case), case["body"]["yaw"])
        for frame in case["frames"]:
            told = frame["motion"]
            if told is None:
                with pytest.raises(ValueError, match="must"):
                    solver.solve(packet_of(frame))
                continue
            motion = solver.solve(packet_of(frame))
            local = axis_angle_to_matrix(np.reshape(told["local"], (-1, 3)))
            assert turned_rad(motion.now.local, local) < TOLERANCE
            np.testing.assert_allclose(motion.now.root, told["root"], atol=TOLERANCE)
            assert list(motion.feet_locked) == told["locked"]
            expression = motion.expression.at(motion.time_s)
            np.testing.assert_allclose(expression, told["expression"], atol=TOLERANCE)


def test_golden_bytes(frames):
    for frame in frames:
        packet = MotionPacket(7, motion_of(frame), live_look=True)
        assert encode_motion(packet).hex() == frame["motion"]["more"]["packet"]


def test_what_goes_up_stays_within_its_budget(whole, short):
    assert (len(short), len(whole)) == (MOTION_BYTES, LONGEST_MOTION_BYTES)
    assert 8 * 30 * (MOTION_BYTES + HEADERS) < 100_000, "bits a second"
    assert 8 * 30 * (LONGEST_MOTION_BYTES + HEADERS) < 120_000


def test_what_comes_back_is_as_near_as_its_bits_allow(frames):
    for frame in frames:
        motion = motion_of(frame)
        back = decode_motion(encode_motion(MotionPacket(5, motion, live_look=True)))
        assert (back.sequence, back.live_look, back.motion.age_ms) == (5, True, 72)
        got = back.motion
        assert got.captured_ms == motion.captured_ms
        assert got.feet_locked == motion.feet_locked
        assert np.degrees(turned_rad(got.now.local, motion.now.local)) < 0.01
        largest = np.abs(motion.ahead).max()
        np.testing.assert_allclose(got.ahead, motion.ahead, atol=largest / 253)
        np.testing.assert_allclose(got.now.root, motion.now.root, atol=1e-6)
        np.testing.assert_allclose(got.ahead_m, motion.ahead_m, atol=1e-6)
        shown = got.expression.at(got.time_s)
        np.testing.assert_allclose(shown, motion.expression.at(motion.time_s), atol=0.51 / 255)
        assert got.seen is not None
        assert motion.seen is not None
        seen, truth = (
            axis_angle_to_matrix(one.pose.joint_angles) for one in (got.seen, motion.seen)
        )
        assert np.degrees(turned_rad(seen, truth)) < 0.02
        assert (got.seen.camera.width, got.seen.camera.height) == (frame["width"], frame["height"])
        assert got.seen.camera.focal_px == motion.seen.camera.focal_px


def test_without_live_look_nothing_is_told_of_the_picture(short):
    back = decode_motion(short)
    assert not back.live_look
    assert back.motion.seen is None


def test_every_other_length_is_refused(whole):
    for length in {*range(len(whole)), len(whole) + 1} - {MOTION_BYTES}:
        with pytest.raises(PacketError, match=f"must be 278 or 360 bytes long; got {length}"):
            decode_motion((whole + b"x")[:length])
    # a head that says otherwise than the length
    with pytest.raises(PacketError, match="360 bytes long while live look is on, else 278"):
        decode_motion(whole[:MOTION_BYTES])


@pytest.mark.parametrize(
    ("offset", "form", "value", "words"),
    [
        (0, "<B", 2, "version 1, kind 8; got version 2, kind 8"),
        (1, "<B", 1, "version 1, kind 8; got version 1, kind 1"),
        (8, "<d", float("nan"), "from 0 to 2.53 ms; got nan"),
        (8, "<d", float("inf"), "from 0 to 2.53 ms; got inf"),
        (8, "<d", -1.0, "from 0 to 2.53 ms; got -1.0"),
        (16, "<f", float("nan"), "root must be within 3 m"),
        (20, "<f", 3.5, "root must be within 3 m"),
        (28, "<f", float("-inf"), "shift must be within 3 m"),
        (40, "<f", float("nan"), "turn by at most 3.15 rad; got nan"),
        (40, "<f", 4.0, "turn by at most 3.15 rad; got 4.0"),
        (40, "<f", -0.1, "turn by at most 3.15 rad"),
        (44, "<Q", 0, "unit quaternions without their largest component"),
        (278, "<H", 0, "a picture must have some size; got 0 x"),
        (282, "<f", float("nan"), "within 100 m of their camera"),
        (294, "<Q", 0, "unit quaternions"),
    ],
)
def test_what_is_no_motion_is_refused_in_words(whole, offset, form, value, words):
    data = bytearray(whole)
    struct.pack_into(form, data, offset, value)
    with pytest.raises(PacketError, match=words):
        decode_motion(bytes(data))


@given(
    st.one_of(*(st.binary(min_size=n, max_size=n) for n in (MOTION_BYTES, LONGEST_MOTION_BYTES)))
)
def test_any_bytes_are_a_finite_motion_of_rotations_or_refused(noise):
    # a head that is let through leads to what is behind it
    for data in (
        noise,
        b"\x01\x08" + noise[2:8] + struct.pack("<d7f", 5.0, *[0.5] * 7) + noise[44:],
    ):
        try:
            motion = decode_motion(data).motion
        except PacketError:
            continue
        local = motion.now.local
        np.testing.assert_allclose(
            local @ np.swapaxes(local, 1, 2), np.tile(np.eye(3), (24, 1, 1)), atol=1e-9
        )
        for numbers in (motion.now.root, motion.ahead, motion.ahead_m, motion.expression.values):
            assert np.isfinite(numbers).all()


def test_nobody_goes_back_in_time_or_faster_than_people_do(frames):
    first = motion_of(frames[0])
    require_plausible(first, None)
    moved = replace(first, captured_ms=first.captured_ms + 40.0)
    require_plausible(moved, first)
    with pytest.raises(PacketError, match="capture time must be later"):
        require_plausible(first, moved)
    far = replace(moved, now=replace(moved.now, root=moved.now.root + np.eye(3)[1]))
    with pytest.raises(PacketError, match="at most 20 m/s; got 25"):
        require_plausible(far, first)


def test_a_body_is_told_in_one_packet_of_the_network(cases):
    case = cases[0]
    data = encode_body(skeleton_of(case), 0.25)
    assert len(data) == BODY_BYTES < 1100
    assert struct.unpack_from("<BBHf", data) == (1, 9, 0, 0.25)
    numbers = np.frombuffer(data, "<f4", offset=8)
    told = [*case["body"]["rest"], *case["body"]["landmarks"]]
    np.testing.assert_allclose(numbers, told, atol=1e-6)
