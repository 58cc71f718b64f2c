"""Pose packets and their feed: golden bytes, bounded error, the right place, nothing unasked."""

from __future__ import annotations

import asyncio
import struct
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
import pytest
from aiortc import RTCDataChannel
from hypothesis import given
from hypothesis import strategies as st

from scene.expression import neutral
from scene.rotations import matrix_to_axis_angle, quaternion_to_matrix
from services.live.packets import (
    BATCHES,
    POSE_BYTES,
    NewestView,
    PacketError,
    PosePacket,
    ViewPacket,
    batches_of,
    decode_pose,
    encode_pose,
    packets_of,
    performer_check,
)
from services.live.room import MeetingPerformer, Room
from services.live.streaming.instrumentation import Instrumentation
from services.live.streaming.pose_feed import PoseFeed, pose_packets
from tests.renderer.studio import make_model, make_motion

GOLDEN = (
    "01020000"
    "07000000"
    "0000000000709740"  # version 1, kind 2, no flags, sequence, 1500.0
    "01036887"
    "0000003f"
    "0000803f"
    "000000c0"  # second of three, check, pelvis
    "b6b6ed6d5b6b" + 23 * "004000200010"  # one turn, z left out  # nothing turned
)


def test_golden_bytes():
    """The page's tests read the same bytes."""
    assert encode_pose(golden_packet()).hex() == GOLDEN


def test_golden_bytes_of_an_expression():
    moved = replace(golden_packet(), expression=np.array([0.2, 1.0, 0.0, 0.4, *[0.0] * 12, 0.6]))
    data = encode_pose(moved)
    assert data.hex() == GOLDEN + "33ff0066" + 12 * "00" + "9907"
    np.testing.assert_allclose(decode_pose(data).expression, moved.expression, atol=0.5 / 255)
    np.testing.assert_array_equal(decode_pose(bytes.fromhex(GOLDEN)).expression, neutral())


def test_an_earlier_recordings_hand_closes_all_its_fingers():
    data = bytes.fromhex(GOLDEN + "33ff0066003399" + "07")
    wanted = [0.2, 1.0, 0.0, 0.4, *[0.0] * 3, *[0.2] * 5, *[0.6] * 5]
    np.testing.assert_allclose(decode_pose(data).expression, wanted, atol=1e-9)


def golden_packet() -> PosePacket:
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (24, 1))
    turns[0] = [0.1, -0.3, 0.2, -0.9]  # of any length, the largest negative
    return PosePacket(7, 1500.0, 1, 3, performer_check("ada"), np.array([0.5, 1.0, -2.0]), turns)


turns = (
    st.lists(st.tuples(*[st.floats(-1, 1)] * 4), min_size=24, max_size=24)
    .map(np.array)
    .filter(lambda q: (np.linalg.norm(q, axis=1) > 1e-2).all())
)
places = st.tuples(*[st.floats(-20, 20, width=32)] * 3).map(np.array)


def test_a_pose_tells_how_old_its_landmarks_were():
    data = encode_pose(replace(golden_packet(), landmarks_age_ms=72))
    assert data.hex() == GOLDEN[:4] + "4800" + GOLDEN[8:]
    assert decode_pose(data).landmarks_age_ms == 72
    assert decode_pose(bytes.fromhex(GOLDEN)).landmarks_age_ms == 0


@given(turns, places, st.integers(0, 2**32 - 1))
def test_every_turn_survives_within_a_hundredth_of_a_degree(turns, place, sequence):
    data = encode_pose(PosePacket(sequence, 12.5, 4, 9, 0xABCD, place, turns))
    assert len(data) == POSE_BYTES == 176
    back = decode_pose(data)
    assert (back.sequence, back.capture_time_ms) == (sequence, 12.5)
    assert (back.index, back.count, back.check) == (4, 9, 0xABCD)
    np.testing.assert_array_equal(back.pelvis, place)
    gap = quaternion_to_matrix(turns).transpose(0, 2, 1) @ quaternion_to_matrix(back.rotations)
    angles = np.linalg.norm(matrix_to_axis_angle(gap), axis=1)
    assert np.degrees(angles.max()) < 0.01


def test_every_truncation_is_refused():
    data = encode_pose(golden_packet())
    for length in range(len(data)):
        with pytest.raises(
            PacketError, match=f"must be 176 or 184 or 192 or 194 bytes long; got {length}"
        ):
            decode_pose(data[:length])


def test_other_kinds_and_infinite_places_are_refused():
    data = bytearray(encode_pose(golden_packet()))
    struct.pack_into("<f", data, 20, float("inf"))
    with pytest.raises(PacketError, match="finite numbers; got \\[inf"):
        decode_pose(bytes(data))
    data[1] = 3
    with pytest.raises(PacketError, match="version 1, kind 2; got version 1, kind 3"):
        decode_pose(bytes(data))


def make_room() -> Room:
    model = make_model(20)
    members = [
        MeetingPerformer("a", "Ada", model, make_motion(4), (1.0, 0.0, -0.5), 0.7),
        MeetingPerformer("b", "Bo", model, make_motion(3), (-1.0, 0.0, 0.0), -2.0),
    ]
    return Room("m", tuple(members))


def test_packets_put_everybody_where_the_renderer_does():
    """Forward kinematics from a packet alone gives the transforms that the server's views use."""
    room = make_room()
    for data, performer in zip(
        pose_packets(room, 0.13, 1), room.scene_at(0.13).performers, strict=True
    ):
        packet, skeleton = decode_pose(data), performer.model.skeleton
        wanted = performer.placement @ skeleton.skinning_transforms(
            performer.pose.joint_angles, performer.pose.root_translation
        )
        made = skeleton.skinning_transforms(
            matrix_to_axis_angle(quaternion_to_matrix(packet.rotations)),
            packet.pelvis - skeleton.rest_joints[0],
        )
        np.testing.assert_allclose(made, wanted, atol=6e-4)
        assert packet.count == 2


def test_packets_carry_what_the_motion_expresses():
    room = make_room()
    smiling = neutral()
    smiling[4] = 0.6
    member = room.performers[0]
    motion = replace(member.motion, expressions=np.tile(smiling, (len(member.motion), 1)))
    room.performers = replace(member, motion=motion), room.performers[1]
    smiles, rests = [decode_pose(data).expression for data in pose_packets(room, 0.13, 1)]
    np.testing.assert_allclose(smiles, smiling, atol=0.5 / 255)
    assert not rests.any()


@dataclass(eq=False)
class Channel:
    """What the feed needs of a data channel."""

    readyState: str = "open"  # noqa: N815
    bufferedAmount: int = 0  # noqa: N815
    protocol: str = ""
    sent: list[bytes] = field(default_factory=list)

    def send(self, data: bytes) -> None:
        self.sent.append(data)


def looking(draws_itself: bool) -> NewestView:
    view = NewestView()
    view.receive(
        ViewPacket(1, 0.0, (0, 0, 0), (1, 0, 0, 0), 0.6, 64, 64, draws_itself=draws_itself)
    )
    return view


async def test_only_who_draws_is_sent_poses_and_only_while_they_can_take_them():
    feed, room = PoseFeed(lambda: 1.0, Instrumentation()), make_room()
    drawing, watching, clogged, silent, gone = (Channel() for _ in range(5))
    clogged.bufferedAmount = 10_000
    gone.readyState = "closed"
    views = [looking(True), looking(False), looking(True), NewestView(), looking(True)]
    channels = [drawing, watching, clogged, silent, gone]
    for view, channel in zip(views, channels, strict=True):
        feed.add(room, view, cast(RTCDataChannel, channel))
    feed.send_newest()
    feed.send_newest()
    assert [len(channel.sent) for channel in channels] == [4, 0, 0, 0, 0]
    packets = [decode_pose(data) for data in drawing.sent]
    assert [(p.sequence, p.index) for p in packets] == [(1, 0), (1, 1), (2, 0), (2, 1)]
    assert [p.check for p in packets[:2]] == [performer_check("a"), performer_check("b")]
    assert len(feed) == 4
    for channel in channels:
        channel.readyState = "closed"
    for _ in range(3):
        await asyncio.sleep(0)
    feed.send_newest()
    assert len(feed) == 0


async def test_whoever_takes_batches_gets_a_tick_in_one_message():
    feed, room = PoseFeed(lambda: 1.0, Instrumentation()), make_room()
    one_by_one, at_once = Channel(), Channel(protocol=BATCHES)
    for channel in (one_by_one, at_once):
        feed.add(room, looking(True), cast(RTCDataChannel, channel))
    feed.send_newest()
    assert (len(one_by_one.sent), len(at_once.sent)) == (2, 1)
    assert list(packets_of(at_once.sent[0])) == one_by_one.sent
    await feed.close()


async def test_each_viewer_gets_the_poses_of_their_own_room():
    feed, rooms = PoseFeed(lambda: 1.0, Instrumentation()), [make_room(), make_room()]
    rooms[1].performers = rooms[1].performers[:1]
    channels = [Channel(), Channel()]
    for room, channel in zip(rooms, channels, strict=True):
        feed.add(room, looking(True), cast(RTCDataChannel, channel))
    feed.send_newest()
    assert [channel.sent for channel in channels] == [pose_packets(r, 1.0, 1) for r in rooms]
    await feed.close()


def test_a_room_with_nobody_in_it_has_no_poses():
    assert pose_packets(Room("empty", ()), 0.0, 1) == []


def test_golden_bytes_of_a_batch():
    """The page's tests read the same bytes."""
    packet = bytes.fromhex(GOLDEN)
    assert [one.hex() for one in batches_of([packet, packet])] == ["0107" + 2 * ("b0" + GOLDEN)]
    assert batches_of([]) == []


def test_batches_fit_into_packets_of_the_network_and_lose_nothing():
    packets = [bytes([n]) * 194 for n in range(12)]
    batches = batches_of(packets)
    assert [len(one) for one in batches] == [2 + 6 * 195] * 2
    assert [packet for one in batches for packet in packets_of(one)] == packets
    # one that is cut off loses its last
    assert list(packets_of(batches[0][:-1])) == packets[:5]


async def test_a_closed_feed_leaves_no_task_behind():
    feed, room, channel = PoseFeed(lambda: 1.0, Instrumentation()), make_room(), Channel()
    feed.add(room, looking(True), cast(RTCDataChannel, channel))
    await asyncio.sleep(0)
    assert len(asyncio.all_tasks()) == 2
    await feed.close()
    assert asyncio.all_tasks() == {asyncio.current_task()}
    sent = len(channel.sent)
    feed.send_newest()
    assert sent > 0
    assert (len(channel.sent), len(feed)) == (sent, 0)
    await feed.close()
