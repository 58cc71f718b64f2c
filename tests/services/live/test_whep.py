"""WHEP with a real WebRTC viewer: the picture comes, follows the viewpoint, and ends cleanly."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import httpx
import pytest

from db.models import ModelRow
from services.auth import INVITED, new_guest
from services.container import Services
from services.gateway import gateway_of
from services.live.rendering import here
from services.live.sessions.view_sessions import ViewSessions
from tests.services import seeds
from tests.services.conftest import bearer
from tests.services.live.viewer import Viewer, view


@pytest.fixture
def model(services: Services, model_file: Path) -> ModelRow:
    return seeds.imported(services, model_file, "house", "Ada")


async def open_meeting(caller: httpx.AsyncClient, model: ModelRow) -> tuple[str, dict[str, str]]:
    """A meeting with Ada in it, and the header of one who has joined."""
    meeting = (
        await caller.post("/v1/meetings", json={"name": "Monday", "model_ids": [model.id]})
    ).json()
    joined = await caller.post(f"/v1/meetings/{meeting['id']}/join", json={"display_name": "Bo"})
    return meeting["id"], {"Authorization": f"Bearer {joined.json()['token']}"}


async def open_seat(
    caller: httpx.AsyncClient, meeting_id: str, header: dict[str, str]
) -> dict[str, str]:
    """The header of one who has joined as whom `header` says."""
    joined = await caller.post(f"/v1/meetings/{meeting_id}/join", json={}, headers=header)
    return {"Authorization": f"Bearer {joined.json()['token']}"}


async def test_the_picture_follows_the_viewpoint_and_the_session_ends(app, caller, model):
    meeting_id, header = await open_meeting(caller, model)
    viewer = Viewer()
    answer = await viewer.look(caller, meeting_id, header)
    assert answer.status_code == 201
    assert answer.headers["content-type"].startswith("application/sdp")
    assert answer.headers["location"].startswith(f"/whep/{meeting_id}/")
    assert answer.headers["etag"]
    await viewer.opened()
    viewer.channel.send(view(1, 0.0, 3.0))
    front = await viewer.frame_of_size(160)
    viewer.channel.send(b"no packet of ours")
    viewer.channel.send(view(2, 2.0, -2.0, 192))
    behind = await viewer.frame_of_size(192)
    assert front.std() > 5
    assert behind.std() > 5
    views: ViewSessions = gateway_of(app).views
    assert len(views) == 1
    gone = await caller.delete(answer.headers["location"], headers=header)
    assert gone.status_code == 200
    assert len(views) == 0
    again = await caller.delete(answer.headers["location"], headers=header)
    assert again.status_code == 204
    await viewer.peer.close()


@pytest.mark.parametrize(
    ("content", "kind", "status", "words"),
    [
        (b"{}", "application/json", 415, "must be of type application/sdp"),
        (b"v=0 nonsense", "application/sdp", 422, "the offer must be an SDP"),
        (b"x" * 70_000, "application/sdp", 413, "at most 65536 bytes"),
        (b"\xff\xfe", "application/sdp", 422, "must be UTF-8"),
    ],
)
async def test_bad_offers_are_refused_in_words(app, caller, model, content, kind, status, words):
    meeting_id, header = await open_meeting(caller, model)
    answer = await caller.post(
        f"/whep/{meeting_id}", content=content, headers=header | {"Content-Type": kind}
    )
    assert answer.status_code == status
    assert words in answer.json()["detail"]
    assert len(gateway_of(app).views) == 0


async def test_what_else_an_offer_sends_is_received_by_nobody(app, caller, model):
    """Else aiortc would decode it, as whatever codec its sender chose, in the gateway itself."""
    meeting_id, header = await open_meeting(caller, model)
    viewer = Viewer()
    for kind in ("audio", "video", "video"):
        viewer.peer.addTransceiver(kind, direction="sendonly")
    viewer.peer.addTransceiver("audio", direction="recvonly")
    answer = await viewer.look(caller, meeting_id, header)
    assert answer.status_code == 201
    await viewer.opened()
    session = gateway_of(app).views.find(answer.headers["location"].rpartition("/")[2])
    assert session is not None
    ways = [one.currentDirection for one in session.connection.getTransceivers()]
    # a picture down, one of the viewer up for live look, and nothing else
    assert sorted(map(str, ways)) == ["inactive", "inactive", "inactive", "recvonly", "sendonly"]
    await viewer.peer.close()


async def test_an_offer_of_many_sections_is_refused(app, caller, model):
    meeting_id, header = await open_meeting(caller, model)
    viewer = Viewer()
    for _ in range(9):
        viewer.peer.addTransceiver("audio", direction="recvonly")
    answer = await viewer.look(caller, meeting_id, header)
    assert answer.status_code == 422
    assert "must have at most 8 sections; got 11; ask for one video" in answer.json()["detail"]
    assert len(gateway_of(app).views) == 0
    await viewer.peer.close()


async def test_tokens_of_other_meetings_and_none_are_refused(caller, model):
    meeting_id, _ = await open_meeting(caller, model)
    _, other = await open_meeting(caller, model)
    offer = {"content": b"v=0", "headers": {"Content-Type": "application/sdp"}}
    foreign = await caller.post(
        f"/whep/{meeting_id}", content=b"v=0", headers=other | {"Content-Type": "application/sdp"}
    )
    assert foreign.status_code == 403
    caller.headers.pop("Authorization")
    nobody = await caller.post(f"/whep/{meeting_id}", **offer)
    assert nobody.status_code == 401


@pytest.mark.parametrize("changes", [{"max_viewers": 0}])
async def test_a_full_server_says_when_to_come_back(caller, model):
    meeting_id, header = await open_meeting(caller, model)
    answer = await Viewer().look(caller, meeting_id, header)
    assert answer.status_code == 503
    assert int(answer.headers["retry-after"]) > 0
    assert "at most 0 viewers" in answer.json()["detail"]


async def test_who_has_no_seat_has_few_views_whatever_the_gateway_has_room_for(
    services, app, caller, model
):
    meeting_id, _ = await open_meeting(caller, model)
    # an account counts for itself; guests, of whom anybody may be many, by their address
    for headers in (
        [bearer(services)] * 3,
        [bearer(services, account) for account in (INVITED, new_guest(), new_guest())],
    ):
        viewers = [Viewer() for _ in headers]
        for viewer, header in zip(viewers, headers, strict=True):
            assert (await viewer.look(caller, meeting_id, header)).status_code == 201
        refused = await Viewer().look(caller, meeting_id, headers[0])
        assert (refused.status_code, refused.headers["retry-after"]) == (429, "10")
        assert "views without a seat must be at most 3 at once" in refused.json()["detail"]
        # others, and who has a seat, are let in
        for other in (
            bearer(services, "another"),
            (await open_seat(caller, meeting_id, headers[0])),
        ):
            welcome = Viewer()
            answer = await welcome.look(caller, meeting_id, other)
            assert answer.status_code == 201
            await caller.delete(answer.headers["location"], headers=other)
            await welcome.peer.close()
        for viewer in viewers:
            await viewer.peer.close()
        async with asyncio.timeout(20):
            while len(gateway_of(app).views):
                await asyncio.sleep(0.05)
        again = Viewer()
        answer = await again.look(caller, meeting_id, headers[0])
        assert answer.status_code == 201
        await caller.delete(answer.headers["location"], headers=headers[0])
        await again.peer.close()


async def test_who_joins_is_told_while_the_renderer_gets_ready(
    caller, app, model, monkeypatch: pytest.MonkeyPatch
):
    meeting_id, _ = await open_meeting(caller, model)
    views: ViewSessions = gateway_of(app).views
    ready = threading.Event()
    # as long as kernels are compiled
    monkeypatch.setattr(here, "warm_up", lambda: ready.wait(20.0))
    views.warm_up()
    join = f"/v1/meetings/{meeting_id}/join"
    assert (await caller.post(join, json={})).json()["ready"] is False
    ready.set()
    for _ in range(400):
        if views.ready:
            break
        await asyncio.sleep(0.05)
    assert (await caller.post(join, json={})).json()["ready"] is True
