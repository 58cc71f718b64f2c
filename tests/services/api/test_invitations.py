"""Who comes to a meeting by what: its id, an invitation that holds or was renewed, a ban."""

from __future__ import annotations

import httpx
import pytest

from db.models import (
    RecordingChunkRow,
    RecordingMemberRow,
    RecordingRow,
    RecordingState,
    new_id,
)
from services.app import create_app
from services.auth import INVITED
from services.container import Services
from services.gateway import gateway_of
from services.recording.chunks import Record, pack
from tests.services.conftest import bearer, changed
from tests.services.control.conftest import on_a_port
from tests.services.control.page import join
from tests.services.live.viewer import Viewer


def _carried(join_url: str) -> dict[str, str]:
    """The header of somebody who opens a link that carries a token."""
    return {"Authorization": f"Bearer {join_url.partition('#token=')[2]}"}


async def _open(client: httpx.AsyncClient) -> dict:
    return (await client.post("/v1/meetings", json={"name": "Monday"})).json()


async def test_a_renewed_invitation_ends_those_of_before_and_sends_nobody_out(
    client: httpx.AsyncClient, services: Services
):
    meeting = await _open(client)
    place = f"/v1/meetings/{meeting['id']}"
    bo, cy = bearer(services, "guest-bo"), bearer(services, "guest-cy")
    seat = (await client.post(f"{place}/join", json={}, headers=bo)).json()
    inside = {"Authorization": f"Bearer {seat['token']}"}
    assert "#token=" not in meeting["join_url"]

    first = (await client.post(f"{place}/invitation")).json()["join_url"]
    second = (await client.post(f"{place}/invitation")).json()["join_url"]
    for came_by in (cy, bo, _carried(first)):
        for answer in (
            await client.get(place, headers=came_by),
            await client.get(f"{place}/environment", headers=came_by),
            await client.post(f"{place}/join", json={}, headers=came_by),
        ):
            assert (answer.status_code, answer.json()["type"]) == (
                403,
                "urn:metanerf:invitation-renewed",
            )
    # who was in stays in, and reads the newest link, as the owner does
    read = await client.get(place, headers=inside)
    for url in (second, read.json()["join_url"]):
        newcomer = await client.post(f"{place}/join", json={}, headers=_carried(url))
        assert newcomer.status_code == 200
    assert (await client.post(f"{place}/join", json={})).json()["role"] == "speaker"


async def test_a_viewer_without_a_seat_goes_when_the_invitation_is_renewed(services: Services):
    app = create_app(services)
    async with on_a_port(app, services) as caller:
        meeting = await _open(caller)
        viewer = Viewer()
        bo = bearer(services, "guest-bo")
        assert (await viewer.look(caller, meeting["id"], bo)).status_code == 201
        await viewer.opened()
        await caller.post(f"/v1/meetings/{meeting['id']}/invitation")
        async with await join(caller, meeting["id"], "Ada") as ada:
            await ada.beat()
            await ada.hear("roster")
            assert len(gateway_of(app).views) == 0
        again = await Viewer().look(caller, meeting["id"], bo)
        assert again.status_code == 403
        await viewer.peer.close()


async def test_whoever_was_sent_out_neither_reads_nor_watches_where_the_lobby_is_off(
    services: Services,
):
    async with on_a_port(create_app(services), services) as caller:
        meeting = await _open(caller)
        place = f"/v1/meetings/{meeting['id']}"
        bo = bearer(services, "guest-bo")
        async with (
            await join(caller, meeting["id"], "Ada") as ada,
            await join(caller, meeting["id"], "Bo", headers=bo) as page,
        ):
            members = await ada.roster(lambda who: len(who) == 2)
            await ada.say(type="remove", participant_id=members["Bo"]["id"])
            await page.gone()
            await ada.say(type="lobby", on=False)
            await ada.beat()
            read = await caller.get(place, headers=bo)
            assert (read.status_code, read.json()["type"]) == (403, "urn:metanerf:removed")
            assert (await Viewer().look(caller, meeting["id"], bo)).status_code == 403


async def test_a_session_is_its_owners_alone(services: Services):
    async with on_a_port(create_app(services), services) as caller:
        meeting = await _open(caller)
        seats = [
            (
                await caller.post(
                    f"/v1/meetings/{meeting['id']}/join", json={}, headers=bearer(services, who)
                )
            ).json()["token"]
            for who in ("guest-bo", "guest-cy")
        ]
        bo, cy = ({"Authorization": f"Bearer {token}"} for token in seats)
        viewer = Viewer()
        session = (await viewer.look(caller, meeting["id"], bo)).headers["location"]
        for method in ("PATCH", "DELETE"):
            for stranger in (cy, bearer(services, "guest-dee")):
                answer = await caller.request(method, session, headers=stranger)
                assert (method, answer.status_code) == (method, 404)
        assert (await caller.delete(session, headers=bo)).status_code == 200
        await viewer.peer.close()


def _recorded(services: Services, meeting_id: str, seats: list[str]) -> str:
    """A recording in which people of these seats agreed who came by invitations."""
    recording = RecordingRow(
        id=new_id(),
        meeting_id=meeting_id,
        account="house",
        name="Monday",
        state=RecordingState.ENDED,
        asked_at=services.clock(),
    )
    recording.members = [
        RecordingMemberRow(participant_id=seat, account=INVITED, name="Guest", agreed=True)
        for seat in seats
    ]
    stored = services.objects.put(recording.id, [pack([Record(0, b"hello")])])
    with services.unit_of_work() as unit:
        unit.recordings.add(recording)
        unit.flush()
        for seat in seats:
            unit.recordings.add_chunk(
                RecordingChunkRow(
                    recording_id=recording.id,
                    track=f"chat:{seat}",
                    number=0,
                    account=INVITED,
                    owner=recording.id,
                    bytes=stored.bytes,
                    sha256=stored.sha256,
                )
            )
        unit.commit()
    return recording.id


@pytest.fixture
def closed(services: Services) -> Services:
    """A server that lets in by invitation only."""
    from dataclasses import replace

    return replace(services, settings=changed(services.settings, open_access=False))


async def test_an_invitation_shows_no_recording_but_that_of_its_own_seat(closed: Services):
    transport = httpx.ASGITransport(create_app(closed), raise_app_exceptions=False)
    async with httpx.AsyncClient(
        transport=transport, base_url="http://test", headers=bearer(closed)
    ) as client:
        meetings = [await _open(client) for _ in range(2)]

        async def seat(meeting: dict) -> tuple[str, dict[str, str]]:
            came_by = _carried(meeting["join_url"])
            place = f"/v1/meetings/{meeting['id']}/join"
            answer = (await client.post(place, json={}, headers=came_by)).json()
            return answer["participant_id"], {"Authorization": f"Bearer {answer['token']}"}

        (bo_id, bo), (cy_id, cy), (_, dee) = (
            await seat(meetings[0]),
            await seat(meetings[0]),
            await seat(meetings[1]),
        )
        _, late = await seat(meetings[0])
        recording = _recorded(closed, meetings[0]["id"], [bo_id, cy_id])
        place = f"/v1/recordings/{recording}"
        shown = {"bo": bo, "cy": cy, "dee": dee, "late": late, "house": bearer(closed)}
        told = {
            who: (
                (await client.get(place, headers=header)).status_code,
                len((await client.get("/v1/recordings", headers=header)).json()["items"]),
            )
            for who, header in shown.items()
        }
        refused, seen = (403, 0), (200, 1)
        assert told == {"bo": seen, "cy": seen, "dee": refused, "late": refused, "house": seen}
        # one takes out what was theirs, the other's stays
        assert (await client.delete(f"{place}/mine", headers=bo)).json()["chunks"] == 1
        assert (await client.get(place, headers=bo)).status_code == 403
        tracks = (await client.get(place, headers=cy)).json()["tracks"]
        assert [track["name"] for track in tracks] == [f"chat:{cy_id}"]


async def test_the_token_of_one_meeting_shows_no_recording_of_another(
    client: httpx.AsyncClient, services: Services
):
    first, second = await _open(client), await _open(client)
    recording = _recorded(services, first["id"], [])
    for meeting, status in ((first, 200), (second, 403)):
        host = {"Authorization": f"Bearer {meeting['host_token']}"}
        answer = await client.get(f"/v1/recordings/{recording}", headers=host)
        assert (meeting["id"], answer.status_code) == (meeting["id"], status)
