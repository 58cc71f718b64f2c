"""A WebRTC viewer who draws for themselves: poses come in place of pictures, and back again; and
one whose line is too slow for either."""

from __future__ import annotations

import asyncio
from itertools import pairwise

from services.gateway import gateway_of
from services.live.packets import (
    PosePacket,
    ViewPacket,
    decode_pose,
    encode_view,
    is_newer,
    performer_check,
)
from tests.services.live.test_whep import app, caller, model, open_meeting
from tests.services.live.viewer import Viewer

__all__ = ["app", "caller", "model"]  # fixtures


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


async def test_poses_come_while_the_viewer_draws_and_pictures_rest(app, caller, model):
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
    await asyncio.sleep(0.5)
    while not poses.empty():
        poses.get_nowait()
    await asyncio.sleep(1.0)
    assert poses.empty()
    assert len(gateway_of(app).views.render_milliseconds()) == rendered

    viewer.channel.send(view(4, draws_itself=False))
    assert (await viewer.frame_of_size(160)).std() > 5
    await viewer.peer.close()
