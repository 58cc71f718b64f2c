"""Now and then a trace says how long a movement took to a picture; never one for each packet."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from scene import Pose
from services.live.packets import NewestView
from services.live.rendering.drawing import RoomPictures, ViewerDrawing, Workload
from services.live.rendering.here import PicturesHere
from services.live.room import MeetingPerformer, Room
from services.live.streaming.encoding import Codec, PictureEncoder
from services.live.streaming.instrumentation import Instrumentation
from services.live.streaming.latency_code import LatencyCode
from services.live.streaming.pacing import TICK_S
from services.live.streaming.traced_pictures import INTERVAL_S, NAME, TracedPictures
from services.live.streaming.view_track import ViewTrack
from services.otlp import OtlpTracing
from tests.renderer.studio import make_model, make_motion
from tests.services.collector import Collector, Span, collecting


class Clock:
    """Goes on a little at each look."""

    now_s = 50.0

    def __call__(self) -> float:
        self.now_s += 1e-4
        return self.now_s


class Driven:
    """Somebody of whom packets come."""

    captured_ms, landmarks_age_ms = 1.7e12, 35
    arrived_s: float | None = None

    def pose_at(self, now_s: float) -> Pose:
        return Pose(np.zeros((24, 3)), np.zeros(3), now_s)


@pytest.fixture
def collector() -> Iterator[Collector]:
    with collecting() as made:
        yield made


@pytest.fixture
def room() -> Room:
    ada = MeetingPerformer("p", "Ada", make_model(), make_motion(20), (0.0, 0.0, 0.0), 0.0)
    return Room("m", (ada,), live_motions={"p": Driven()})


async def _watched(
    room: Room, collector: Collector, pictures: int, packets_every: int, viewers: int = 1
) -> list[Span]:
    """The traces of so many pictures, of which every so many'th shows another packet."""
    clock, tracing = Clock(), OtlpTracing(collector.url)
    traced = TracedPictures(tracing, Instrumentation(), clock)
    shared, ada = RoomPictures(), room.live_motions["p"]
    assert isinstance(ada, Driven)

    def drawn_here() -> PicturesHere:
        drawing = ViewerDrawing(PictureEncoder(Codec.H264), Workload(), clock)
        return PicturesHere(room, shared, drawing, threads)

    with ThreadPoolExecutor(1) as threads:
        tracks = [
            ViewTrack(room, drawn_here(), NewestView(), traced, clock) for _ in range(viewers)
        ]
        for number in range(pictures):
            if number % packets_every == 0:
                ada.arrived_s = clock.now_s
            clock.now_s += TICK_S
            for track in tracks:
                await track.recv()
    tracing.close()
    return collector.named(NAME)


async def test_a_picture_is_traced_from_the_packet_on(room: Room, collector: Collector):
    (whole,) = await _watched(room, collector, pictures=3, packets_every=2)
    parts = [one for one in collector.spans if one.is_in(whole)]
    assert [one.name for one in parts] == ["solve and wait", "draw", "encode"]
    assert parts[0].begin_ns == whole.begin_ns
    for before, after in itertools.pairwise(parts):
        assert before.begin_ns < before.end_ns == after.begin_ns
    assert parts[-1].end_ns == whole.end_ns
    assert 30e6 < parts[0].end_ns - parts[0].begin_ns < 40e6  # a tick
    assert whole.attributes == {"picture.width": "512", "picture.height": "512"}


async def test_thirty_packets_a_second_make_a_trace_in_five(room: Room, collector: Collector):
    seconds = 2.5 * INTERVAL_S
    traces = await _watched(room, collector, round(seconds / TICK_S), packets_every=1, viewers=2)
    assert len(traces) == 3


async def test_a_packet_that_was_shown_already_is_not_traced(room: Room, collector: Collector):
    assert await _watched(room, collector, pictures=200, packets_every=1000) == []


async def test_whoever_is_not_driven_is_not_traced(room: Room, collector: Collector):
    room.live_motions["p"] = Driven()
    traced = TracedPictures(OtlpTracing(collector.url), Instrumentation(), Clock())
    assert traced.begin_picture(room, 60.0) is None


def test_pictures_carry_the_code_as_before(room: Room, collector: Collector):
    traced = TracedPictures(OtlpTracing(collector.url), LatencyCode(), Clock())
    assert traced.stamp_ms(room) == Driven.captured_ms
    assert traced.pose_time_ms(room, 1.0) == Driven.captured_ms
