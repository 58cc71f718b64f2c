"""A WebRTC viewer who draws for themselves: poses come in place of pictures, and back again; and
one whose line is too slow for either."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from services.gateway import gateway_of
from services.live.packets import (
    PosePacket,
    ViewPacket,
    decode_pose,
    encode_view,
    is_newer,
    performer_check,
)
from services.live.streaming.pose_feed import PoseFeed
from tests.services.live.test_whep import model, open_meeting
from tests.services.live.viewer import Viewer

__all__ = ["model"]  # a fixture


def view(sequence: int, *, draws_itself: bool, sound_only: bool = False) -> bytes:
    packet = ViewPacket(
        sequence,
        0.0,
        (0.0, 1.2, 3.0),
        (0.0, 1.0, 0.0, 0.0),
        0.7,
        160,
        160,
        draws_itself=draws_itself,
        sound_only=sound_only,
    )
    return encode_view(packet)


async def newest(poses: asyncio.Queue[bytes]) -> PosePacket:
    return decode_pose(await asyncio.wait_for(poses.get(), 20))


class Ticks:
    """Counts how often the feed sent what there was to send."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.count, send_newest = 0, PoseFeed.send_newest

        def counted(feed: PoseFeed) -> None:
            send_newest(feed)
            self.count += 1

        monkeypatch.setattr(PoseFeed, "send_newest", counted)

    async def past(self, count: int) -> None:
        """Wait for so many more."""
        due = self.count + count
        while self.count < due:
            await asyncio.sleep(0.005)


async def until_quiet(poses: asyncio.Queue[bytes], ticks: Ticks) -> None:
    """Wait for half a second's ticks after which no pose has come."""
    async with asyncio.timeout(20):
        while True:
            while not poses.empty():
                poses.get_nowait()
            await ticks.past(15)
            if poses.empty():
                return


async def test_poses_go_out_by_one_channel_of_a_viewer_however_many_they_open(app, caller, model):
    meeting_id, header = await open_meeting(caller, model)
    viewer = Viewer()
    answer = await viewer.look(caller, meeting_id, header)
    assert answer.status_code == 201
    await viewer.opened()
    viewer.channel.send(view(1, draws_itself=True))
    for label in ("pose", "look"):
        channels = [viewer.peer.createDataChannel(label) for _ in range(5)]
        async with asyncio.timeout(20):
            while [one.readyState for one in channels] != 4 * ["closed"] + ["open"]:
                await asyncio.sleep(0.02)
        if label == "pose":
            poses: asyncio.Queue[bytes] = asyncio.Queue()
            channels[-1].on("message", poses.put_nowait)
            await newest(poses)
    await viewer.peer.close()


async def test_poses_come_while_the_viewer_draws_and_pictures_rest(app, caller, model, monkeypatch):
    ticks = Ticks(monkeypatch)
    meeting_id, header = await open_meeting(caller, model)
    viewer = Viewer()
    channel = viewer.peer.createDataChannel("pose", ordered=False, maxRetransmits=0)
    poses: asyncio.Queue[bytes] = asyncio.Queue()
    channel.on("message", poses.put_nowait)
    assert (await viewer.look(caller, meeting_id, header)).status_code == 201
    await viewer.opened()
    viewer.channel.send(view(1, draws_itself=False))
    await viewer.frame()
    assert poses.empty()

    viewer.channel.send(view(2, draws_itself=True))
    packets = [await newest(poses) for _ in range(6)]
    performers = (await caller.get(f"/v1/meetings/{meeting_id}")).json()["performers"]
    assert {(p.index, p.count, p.check) for p in packets} == {
        (0, 1, performer_check(performers[0]["id"]))
    }
    for before, after in pairwise(packets):
        assert is_newer(after.sequence, before.sequence)
        assert after.capture_time_ms > before.capture_time_ms
    rendered = len(gateway_of(app).views.render_milliseconds())
    for _ in range(10):
        await newest(poses)
    assert len(gateway_of(app).views.render_milliseconds()) == rendered

    viewer.channel.send(view(3, draws_itself=True, sound_only=True))
    await until_quiet(poses, ticks)
    assert len(gateway_of(app).views.render_milliseconds()) == rendered

    viewer.channel.send(view(4, draws_itself=False))
    assert (await viewer.frame_of_size(160)).std() > 5
    await viewer.peer.close()
