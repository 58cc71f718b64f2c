"""Pictures on their way to pages that draw: to whom they go, from which frame on, and their end."""

from __future__ import annotations

import struct
from typing import cast

import numpy as np
import pytest
from aiortc import RTCDataChannel

from scene.camera import Camera
from scene.expression import neutral
from scene.motion import Pose
from scene.rotations import matrix_to_axis_angle, quaternion_to_matrix
from services.live.look.packets import HEADER, Whose, encode_aligned_pose, encode_end, encode_frame
from services.live.look.picture import AlignedPose
from services.live.look.relay import LookRelay
from services.live.packets import Kind, decode_pose, performer_check
from services.live.room import Room
from services.live.streaming.look_feed import LookFeed
from tests.services.live.test_pose_feed import Channel, looking, make_room

KEY, NEXT = b"\x10key", b"\x11next"
GOLDEN_END = "010601036887000000000000"


def aligned() -> AlignedPose:
    angles = np.zeros((24, 3))
    angles[16, 2] = -1.2
    smiling = neutral()
    smiling[4] = 0.6
    k = np.array([[900.0, 0.0, 140.0], [0.0, 910.0, 150.0], [0.0, 0.0, 1.0]])
    camera = Camera(k, np.eye(3, 4), 288, 288)
    return AlignedPose(
        Pose(angles, np.zeros(3), 5.0, smiling), np.array([0.1, -0.4, -1.5]), camera, 7.25
    )


def test_golden_bytes():
    """The page's tests read the same bytes."""
    whose = Whose(1, 3, performer_check("ada"))
    assert encode_end(whose).hex() == GOLDEN_END
    assert encode_frame(whose, 258, KEY).hex() == "0104010368870100" + "02010000" + KEY.hex()
    assert encode_frame(whose, 259, NEXT).hex() == "0104010368870000" + "03010000" + NEXT.hex()


def test_a_pose_tells_camera_place_and_moment():
    whose = Whose(1, 3, performer_check("ada"))
    data = encode_aligned_pose(whose, 258, aligned())
    version, kind, index, count, check, flags, number = HEADER.unpack_from(data)
    assert (version, kind, index, count, check, flags, number) == (1, 5, 1, 3, whose.check, 0, 258)
    assert struct.unpack_from("<4f", data, 12) == (900.0, 910.0, 140.0, 150.0)
    packet = decode_pose(data[28:])
    assert (packet.sequence, packet.capture_time_ms) == (258, 7250.0)
    assert (packet.index, packet.count, packet.check) == (1, 3, whose.check)
    np.testing.assert_allclose(packet.pelvis, [0.1, -0.4, -1.5], atol=1e-6)
    turns = matrix_to_axis_angle(quaternion_to_matrix(packet.rotations))
    np.testing.assert_allclose(turns, aligned().pose.joint_angles, atol=2e-4)
    np.testing.assert_allclose(packet.expression, aligned().pose.expression, atol=0.5 / 255)


class Feed:
    """A feed, a room of Ada and Bo, and a relay of Bo's pictures."""

    def __init__(self) -> None:
        self.feed, self.room = LookFeed(), make_room()
        self.relay: LookRelay = self.feed.relay(self.room, "b")

    def viewer(self, *, draws: bool = True, room: Room | None = None) -> Channel:
        channel = Channel()
        self.feed.add(room or self.room, looking(draws), cast(RTCDataChannel, channel))
        return channel


@pytest.fixture
def made() -> Feed:
    return Feed()


def kinds(channel: Channel) -> list[tuple[int, int]]:
    """Kind and number of each packet that was sent."""
    return [(data[1], HEADER.unpack_from(data)[-1]) for data in channel.sent]


def test_only_those_in_the_meeting_who_draw_get_pictures(made):
    drawing, watching = made.viewer(), made.viewer(draws=False)
    elsewhere = made.viewer(room=make_room())
    assert made.relay.drawn_model() is None
    assert not made.relay.pass_frame(1, KEY)
    made.relay.pass_pose(1, aligned())
    assert not made.relay.pass_frame(2, NEXT)
    made.relay.end()
    assert kinds(drawing) == [
        (Kind.LOOK_FRAME, 1),
        (Kind.LOOK_POSE, 1),
        (Kind.LOOK_FRAME, 2),
        (Kind.LOOK_END, 0),
    ]
    assert drawing.sent[0][2:4] == bytes([1, 2])
    assert (watching.sent, elsewhere.sent) == ([], [])


def test_whoever_comes_later_begins_with_a_key_frame(made):
    first = made.viewer()
    made.relay.pass_frame(1, KEY)
    second = made.viewer()
    assert made.relay.pass_frame(2, NEXT), "somebody can't decode that"
    made.relay.pass_pose(2, aligned())
    assert (len(first.sent), second.sent) == (3, [])
    assert not made.relay.pass_frame(3, KEY)
    assert kinds(second) == [(Kind.LOOK_FRAME, 3)]


def test_a_clogged_channel_is_left_out_until_a_key_frame_fits(made):
    channel = made.viewer()
    made.relay.pass_frame(1, KEY)
    channel.bufferedAmount = 50_000
    assert not made.relay.pass_frame(2, KEY), "there is no room for a key frame either"
    assert made.relay.drawn_model() is None
    channel.bufferedAmount = 0
    assert made.relay.pass_frame(3, NEXT)
    assert not made.relay.pass_frame(4, KEY)
    made.relay.end()
    assert kinds(channel) == [(Kind.LOOK_FRAME, 1), (Kind.LOOK_FRAME, 4), (Kind.LOOK_END, 0)]


def test_the_end_reaches_also_who_stopped_following_and_comes_once(made):
    channel = made.viewer()
    made.relay.pass_frame(1, KEY)
    channel.bufferedAmount = 50_000
    made.relay.pass_frame(2, NEXT)
    made.relay.end()
    made.relay.end()
    assert kinds(channel) == [(Kind.LOOK_FRAME, 1), (Kind.LOOK_END, 0)]
    made.relay.pass_pose(2, aligned())
    assert len(channel.sent) == 2


def test_a_closed_channel_and_somebody_taken_out_get_nothing(made):
    gone, here = made.viewer(), made.viewer()
    made.relay.pass_frame(1, KEY)
    gone.readyState = "closed"
    made.relay.pass_frame(2, NEXT)
    assert (len(gone.sent), len(here.sent)) == (1, 2)
    assert made.relay.drawn_model() is made.room.performers[1].model
    made.room.performers = made.room.performers[:1]
    assert not made.relay.pass_frame(3, NEXT)
    assert made.relay.drawn_model() is None
    made.relay.end()
    assert len(here.sent) == 2
