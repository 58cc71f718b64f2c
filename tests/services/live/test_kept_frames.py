"""Pictures are kept over a real connection with consent alone, and dropped without a word."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI

from capture.storage import open_sequence
from db.models import JobKind, Purpose, SequenceKind, SequenceRow, SequenceState
from renderer.model_files import save_model
from services.auth import ALL_SCOPES
from services.container import Services
from services.gateway import gateway_of
from services.jobs.packing import unpack
from services.live.look.keeping import Keeping
from services.live.room import Room
from services.live.sessions.view_sessions import ViewSessions
from services.meetings import create_meeting
from tests.renderer.live_look.people import person_in_checks, seen_from
from tests.services import seeds
from tests.services.api.authorisation_world import DAY
from tests.services.live.test_live_look import Sender

EVERY_PURPOSE = [purpose.value for purpose in Purpose]


@pytest.fixture(scope="module")
def in_checks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of Ada's model."""
    path = tmp_path_factory.mktemp("checks") / "ada.safetensors"
    save_model(person_in_checks(), path)
    return path


@pytest.fixture
async def room(
    services: Services, views: ViewSessions, in_checks: Path, sequence_folder: Path
) -> Room:
    """Ada of account `house`, whose model has a clip, and who consents to all."""
    row = seeds.with_clip(services, in_checks, sequence_folder)
    with services.unit_of_work() as unit:
        unit.people.get(row.person_id).consent_purposes = EVERY_PURPOSE
        meeting = create_meeting(services, unit, "house", "Monday", [unit.models.get(row.id)])
        unit.commit()
    return await views.room(meeting.id)


class Page:
    """A page that drives Ada, and what it asks about kept frames."""

    def __init__(self, app: FastAPI, services: Services, room: Room) -> None:
        self._room, self.views = room, gateway_of(app).views
        self.sender = Sender(room, "Ada")
        token, _ = services.tokens.issue("house", ALL_SCOPES, DAY)
        self.http = httpx.AsyncClient(
            transport=httpx.ASGITransport(app),
            base_url="http://test",
            headers={"Authorization": f"Bearer {token}"},
        )
        self.path = ""

    async def connect(self, *, live_look: bool = True) -> Page:
        await self.sender.connect(self.views, self._room, "house")
        session_id = self.sender.session_id
        self.path = f"/whep/{self._room.meeting_id}/{session_id}/kept-frames"
        await self.sender.drive(0.2, live_look=live_look)
        return self

    @property
    def keeping(self) -> Keeping:
        session = self.views.find(self.sender.session_id)
        assert session is not None
        found = self.views.kept_of(session)
        assert found is not None
        return found[1]

    async def switch(self, on: bool) -> httpx.Response:
        return await self.http.put(self.path, json={"on": on})

    def turn(self, degrees: float, time_s: float) -> None:
        """Have the server see them from so many degrees to their left."""
        (performer,) = self._room.performers
        model = performer.model.splats
        assert model is not None
        picture = seen_from(model, degrees, time_s)
        self.keeping.look_at(model, picture, picture.pose)

    async def leave(self) -> None:
        await self.sender.viewer.peer.close()
        await self.http.aclose()


@pytest.fixture
async def page(app: FastAPI, services: Services, room: Room) -> AsyncIterator[Page]:
    made = await Page(app, services, room).connect()
    yield made
    await made.leave()


def kept_rows(services: Services, room: Room) -> list[SequenceRow]:
    with services.reading() as unit:
        (performer,) = unit.meetings.get(room.meeting_id).performers
        rows = unit.sequences.of_person(performer.person_id)
        return [one for one in rows if one.kind is SequenceKind.LIVE]


async def test_nothing_is_kept_until_it_is_asked_for(page):
    page.turn(120, 1.0)
    shown = (await page.http.get(page.path)).json()
    assert shown == {"on": False, "frames": []}


async def test_new_sides_are_shown_and_kept_pictures_are_stored_when_their_owner_says_so(
    page, services, room, tmp_path
):
    assert (await page.switch(True)).json() == {"on": True, "frames": []}
    page.turn(120, 1.0)
    shown = (await page.switch(False)).json()
    assert shown["on"] is False
    (frame,) = shown["frames"]
    assert "head from 120 degrees to their left" in frame["sides"]
    assert frame["picture"].startswith("data:image/png;base64,")
    page.turn(-120, 2.0)
    assert len((await page.http.get(page.path)).json()["frames"]) == 1, "it is off"
    assert kept_rows(services, room) == []
    answer = await page.http.post(page.path)
    assert answer.status_code == 202, answer.text
    (row,) = kept_rows(services, room)
    job = answer.json()
    assert (job["kind"], job["sequence_id"]) == (JobKind.TRAIN, row.id)
    assert (row.state, row.frames) == (SequenceState.READY, 1)
    assert row.packed_sha256 is not None
    unpack(services.objects, row.person_id, row.packed_sha256, tmp_path / "kept")
    stored = open_sequence(tmp_path / "kept")
    assert len(stored.train) == 1
    assert stored.train.mask(0).max() == 1.0
    with services.reading() as unit:
        actions = [one.action for one in unit.audit.of_account("house")]
    assert "sequence.kept" in actions
    assert (await page.http.get(page.path)).json() == {"on": False, "frames": []}
    assert (await page.http.post(page.path)).status_code == 409, "it is stored already"


async def test_dropped_is_dropped(page, services, room):
    await page.switch(True)
    page.turn(120, 1.0)
    assert page.keeping.frames
    assert (await page.http.delete(page.path)).status_code == 204
    assert (await page.http.get(page.path)).json() == {"on": False, "frames": []}
    assert (await page.http.post(page.path)).status_code == 409
    assert kept_rows(services, room) == []


async def test_who_leaves_without_a_word_drops_them(page, services, room):
    await page.switch(True)
    page.turn(120, 1.0)
    keeping = page.keeping
    await page.sender.viewer.peer.close()
    for _ in range(200):
        if not keeping.frames:
            break
        await asyncio.sleep(0.02)
    assert keeping.frames == []
    assert not keeping.on
    assert kept_rows(services, room) == []


async def test_a_consent_that_ends_drops_them_and_what_is_stored(page, services, room):
    await page.switch(True)
    page.turn(120, 1.0)
    assert (await page.http.post(page.path)).status_code == 202
    await page.switch(True)
    page.turn(120, 5.0)
    assert len(page.keeping.frames) == 1
    (row,) = kept_rows(services, room)
    packed = row.packed_sha256
    assert packed is not None
    consent = {"purposes": ["meetings"], "until": None}
    answer = await page.http.put(f"/v1/people/{row.person_id}/consent", json=consent)
    assert answer.status_code == 200
    assert page.keeping.frames == []
    assert not page.keeping.on
    (row,) = kept_rows(services, room)
    assert (row.state, row.packed_sha256) == (SequenceState.FORGOTTEN, None)
    assert packed not in {one.sha256 for one in services.objects.list(row.person_id)}
    with services.reading() as unit:
        assert all(job.state.final for job in unit.jobs.of_sequence(row.id))
    assert (await page.switch(True)).json()["type"] == "urn:metanerf:no-consent"


async def test_erasing_the_person_erases_them(page, services, room):
    await page.switch(True)
    page.turn(120, 1.0)
    await page.http.post(page.path)
    (row,) = kept_rows(services, room)
    assert (await page.http.delete(f"/v1/people/{row.person_id}")).status_code == 200
    assert not list(services.objects.list(row.person_id))


async def test_without_its_clip_a_model_learns_nothing_more(page, services, room):
    with services.unit_of_work() as unit:
        (performer,) = unit.meetings.get(room.meeting_id).performers
        (clip,) = unit.sequences.of_person(performer.person_id)
        clip.packed_sha256, clip.state = None, SequenceState.FORGOTTEN
        unit.commit()
    answer = await page.switch(True)
    assert (answer.status_code, answer.json()["type"]) == (410, "urn:metanerf:clip-gone")
    assert not page.keeping.on


async def test_somebody_else_may_not_ask(page, app, services):
    token, _ = services.tokens.issue("other", ALL_SCOPES, DAY)
    page.http.headers["Authorization"] = f"Bearer {token}"
    await page.switch(True)
    assert not page.keeping.on
    for answer in (await page.switch(True), await page.http.get(page.path)):
        assert answer.status_code == 403


async def test_a_connection_that_drives_nobody_keeps_nothing(page):
    page.sender.channel.close()
    for _ in range(100):
        await asyncio.sleep(0.02)
        answer = await page.switch(True)
        if answer.status_code == 409:
            break
    assert answer.json()["type"] == "urn:metanerf:not-keepable"
