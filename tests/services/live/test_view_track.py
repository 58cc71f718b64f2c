"""A viewer's video by a clock of our own: the newest wins, equal views are drawn once, key frames
come to whom they are due."""

from __future__ import annotations

import asyncio
import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from aiortc.rtp import (
    RTCP_PSFB_APP,
    RTCP_PSFB_FIR,
    RTCP_PSFB_PLI,
    RTCP_RTPFB_NACK,
    RtcpPsfbPacket,
    RtcpReceiverInfo,
    RtcpRrPacket,
    RtcpRtpfbPacket,
    pack_remb_fci,
)
from prometheus_client import REGISTRY

from scene import Pose
from services.live.packets import NewestView, ViewPacket
from services.live.rendering.drawing import RoomPictures, ViewerDrawing, Workload
from services.live.rendering.here import PicturesHere
from services.live.room import MeetingPerformer, Room
from services.live.streaming.encoding import BITRATES, Codec, PictureEncoder
from services.live.streaming.instrumentation import Instrumentation
from services.live.streaming.pacing import TICK_S
from services.live.streaming.rtcp_feedback import apply_feedback
from services.live.streaming.view_track import ViewTrack, frame_size
from tests.renderer.studio import make_model, make_motion

VIEW = ViewPacket(1, 0.0, (0.0, 1.0, 3.0), (0.0, 1.0, 0.0, 0.0), 0.7, 128, 128)


class Clock:
    """Moves when it is told to."""

    now_s = 50.01  # within a tick

    def __call__(self) -> float:
        return self.now_s


class CountingView(NewestView):
    """Counts how often it is asked whether pictures are wanted."""

    asked = 0

    @property
    def wants_pictures(self) -> bool:
        self.asked += 1
        return super().wants_pictures


@pytest.fixture
def room() -> Room:
    return Room(
        "m", (MeetingPerformer("p", "Ada", make_model(), make_motion(20), (0.0, 0.0, 0.0), 0.0),)
    )


@pytest.fixture
def threads():
    with ThreadPoolExecutor(1) as executor:
        yield executor


def track_of(room: Room, threads, clock: Clock, view: NewestView | None = None) -> ViewTrack:
    drawing = ViewerDrawing(PictureEncoder(Codec.H264), Workload(), clock)
    pictures = PicturesHere(room, RoomPictures(), drawing, threads)
    return ViewTrack(room, pictures, view or NewestView(), Instrumentation(), clock)


async def keys(track: ViewTrack, clock: Clock, count: int) -> list[bool]:
    """Whether each of the next pictures is a key frame."""
    found = []
    for _ in range(count):
        clock.now_s += TICK_S
        found.append((await track.recv()).is_keyframe)
    return found


async def test_each_picture_has_the_time_of_its_tick_and_missed_ones_are_dropped(room, threads):
    clock = Clock()
    track, stamps = track_of(room, threads, clock), []
    for pause in (0.0, 1.0, 1.0, 4.6, 1.0):
        clock.now_s += pause * TICK_S
        packet = await track.recv()
        assert packet.pts is not None
        stamps.append(packet.pts // 3000)
    assert [b - a for a, b in itertools.pairwise(stamps)] == [1, 1, 4, 1]


@pytest.mark.parametrize("kind", [RTCP_PSFB_PLI, RTCP_PSFB_FIR])
async def test_a_key_frame_comes_once_and_only_to_who_asks(room, threads, kind):
    clock = Clock()
    mine, other = (track_of(room, threads, clock) for _ in range(2))
    assert await keys(mine, clock, 3) == [True, False, False]
    assert await keys(other, clock, 3) == [True, False, False]
    apply_feedback(RtcpPsfbPacket(kind, 1, 2), mine, 2)
    assert await keys(mine, clock, 2) == [True, False]
    assert await keys(other, clock, 2) == [False, False]


async def test_who_says_that_pictures_stopped_gets_a_key_frame_now_and_then(room, threads):
    clock, view = Clock(), NewestView()
    track = track_of(room, threads, clock, view)
    view.receive(VIEW)
    assert await keys(track, clock, 2) == [True, False]
    view.receive(replace(VIEW, sequence=2, stalled=True))
    assert sum(await keys(track, clock, 30)) == 2  # one in half a second
    view.receive(replace(VIEW, sequence=3))
    assert not any(await keys(track, clock, 30))


async def test_who_goes_on_with_sound_alone_costs_no_drawing_and_begins_anew(room, threads):
    clock, view = Clock(), CountingView()
    track = track_of(room, threads, clock, view)
    view.receive(VIEW)
    assert await keys(track, clock, 2) == [True, False]
    view.receive(replace(VIEW, sequence=2, sound_only=True))
    clock.now_s += 1.0
    coming = asyncio.create_task(track.recv())
    asked = view.asked
    while view.asked < asked + 5:
        await asyncio.sleep(0)
    assert not coming.done()
    assert len(track.render_seconds) == 2
    view.receive(replace(VIEW, sequence=3))
    assert (await coming).is_keyframe
    assert await keys(track, clock, 2) == [False, False]


class ReleasedEncoder(PictureEncoder):
    """Tells whether it was released."""

    released = False

    def release(self) -> None:
        self.released = True
        super().release()


async def test_who_draws_by_themselves_holds_no_encoder_until_they_want_pictures_again(
    room, threads
):
    clock, view = Clock(), CountingView()
    encoder = ReleasedEncoder(Codec.H264)
    drawing = ViewerDrawing(encoder, Workload(), clock)
    pictures = PicturesHere(room, RoomPictures(), drawing, threads)
    track = ViewTrack(room, pictures, view, Instrumentation(), clock)
    await keys(track, clock, 2)
    assert not encoder.released
    view.receive(replace(VIEW, draws_itself=True))
    drawing = asyncio.create_task(keys(track, clock, 2))
    while view.asked < 5:
        await asyncio.sleep(0.01)
    assert encoder.released
    view.receive(replace(VIEW, sequence=2))
    assert await drawing == [True, False]


async def test_key_frames_asked_for_in_a_row_come_three_times_a_second(room, threads):
    clock = Clock()
    track, found = track_of(room, threads, clock), []
    for _ in range(30):
        track.request_key_frame()
        found += await keys(track, clock, 1)
    assert sum(found) == 3
    assert found[:9] == [True, *8 * [False]]
    assert any(await keys(track, clock, 10))  # none that was asked for is forgotten


def test_of_what_was_lost_the_newest_is_sent_again_and_nothing_once_there_is_sound_alone(
    room, threads
):
    view, clock = NewestView(), Clock()
    track = track_of(room, threads, clock, view)
    again = track.worth_resending(range(1000))
    assert again == list(range(1000 - len(again), 1000))
    assert 20 <= len(again) <= 100
    assert track.worth_resending([1000]) == []
    clock.now_s += 1.0
    assert track.worth_resending([1001]) == [1001]
    view.receive(replace(VIEW, sound_only=True))
    clock.now_s += 1.0
    assert track.worth_resending([1002]) == []


def test_estimates_of_the_receiver_set_the_bitrate_and_other_messages_do_not(room, threads):
    track = track_of(room, threads, Clock())
    apply_feedback(RtcpPsfbPacket(RTCP_PSFB_APP, 1, 2, pack_remb_fci(800_000, [3])), track, 3)
    assert track.bitrate.bitrate == BITRATES[1]
    apply_feedback(RtcpPsfbPacket(RTCP_PSFB_APP, 1, 2, b"something else"), track, 3)
    assert track.bitrate.bitrate == BITRATES[1]


def report(ssrc: int, lost: float) -> RtcpRrPacket:
    return RtcpRrPacket(1, [RtcpReceiverInfo(ssrc, int(256 * lost), 0, 0, 0, 0, 0)])


def test_losses_lower_the_bitrate_of_the_pictures_alone_and_while_they_are_wanted(room, threads):
    view = NewestView()
    track = track_of(room, threads, Clock(), view)
    first = track.bitrate.bitrate
    apply_feedback(report(4, lost=0.5), track, 3)  # of another stream: what is sent again
    assert track.bitrate.bitrate == first
    apply_feedback(report(3, lost=0.5), track, 3)
    lower = track.bitrate.bitrate
    assert lower < first
    view.receive(replace(VIEW, sound_only=True))
    for _ in range(50):
        apply_feedback(report(3, lost=0.0), track, 3)  # nothing was sent, nothing is learnt
    assert track.bitrate.bitrate == lower


def test_a_request_for_lost_packets_keeps_those_that_are_sent_again(room, threads):
    track = track_of(room, threads, Clock())
    asked = RtcpRtpfbPacket(RTCP_RTPFB_NACK, 1, 3, list(range(1000)))
    apply_feedback(asked, track, 3)
    assert 20 <= len(asked.lost) <= 100
    assert asked.lost[-1] == 999


def test_sizes_shrink_in_blocks_and_keep_their_shape():
    assert frame_size(1024, 512, 0.75) == (768, 384)
    assert frame_size(512, 512, 0.5) == (256, 256)
    assert frame_size(4000, 1000, 0.5) == (512, 128)
    assert frame_size(200, 200, 0.5) == (128, 128)


@pytest.mark.parametrize(("width", "height"), [(320, 192), (1400, 850), (192, 400), (1024, 140)])
def test_the_smallest_picture_has_the_shape_of_the_window(width, height):
    wide, high = frame_size(width, height, 0.05)
    assert min(wide, high) == 128
    assert wide / high == pytest.approx(width / height, rel=0.05)


def test_shapes_beyond_every_size_are_drawn_within_bounds():
    assert frame_size(4000, 10, 0.5) == (1024, 128)


class Driven:
    """Somebody of whom motion comes."""

    captured_ms, landmarks_age_ms = 1.7e12, 35
    arrived_s: float | None = None

    def pose_at(self, now_s: float) -> Pose:
        return Pose(np.zeros((24, 3)), np.zeros(3), now_s)


def figure(name: str, **labels: str) -> float:
    return REGISTRY.get_sample_value(name, labels) or 0.0


async def test_pictures_are_counted_and_timed_and_each_motion_once(room, threads):
    clock, ada = Clock(), Driven()
    room.live_motions["p"] = ada
    track = track_of(room, threads, clock)
    names = {
        "pictures": ("metanerf_pictures_total", {}),
        "drawn": ("metanerf_picture_seconds_count", {"step": "draw"}),
        "encoded": ("metanerf_picture_seconds_count", {"step": "encode"}),
        "motions": ("metanerf_motion_age_seconds_count", {}),
        "age_s": ("metanerf_motion_age_seconds_sum", {}),
    }
    before = {key: figure(name, **labels) for key, (name, labels) in names.items()}
    # long before anybody looked; then one that two pictures show, and one more
    arrivals = (clock.now_s - 60.0, None, clock.now_s + 2.0 * TICK_S, None, None, None)
    for number, arrived_s in enumerate(arrivals):
        ada.arrived_s = ada.arrived_s if arrived_s is None else arrived_s
        if number == 5:
            ada.arrived_s = clock.now_s + 0.5 * TICK_S
        clock.now_s += TICK_S
        await track.recv()
    after = {key: figure(name, **labels) for key, (name, labels) in names.items()}
    grown = {key: after[key] - before[key] for key in names}
    assert grown.pop("age_s") == pytest.approx((1.0 + 0.5) * TICK_S)
    assert grown == {"pictures": 6, "drawn": 6, "encoded": 6, "motions": 2}
