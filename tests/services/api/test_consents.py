"""A consent is read, given and revoked, ends by itself, and gates what is done with a likeness."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import httpx
import pytest

from db.models import ModelRow
from services.auth import GUEST
from services.bootstrap import import_model
from services.container import Services
from tests.fakes import Clock
from tests.services import seeds
from tests.services.conftest import bearer, calling

USUAL = {"purposes": ["meetings", "recordings"], "until": None, "state": "given"}


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def timed(services: Services, clock: Clock) -> Services:
    """The services by the tests' clock, but for the tokens'."""
    clock.now = services.clock()
    return replace(services, clock=clock)


@pytest.fixture
async def client(timed: Services) -> AsyncIterator[httpx.AsyncClient]:
    async with calling(timed) as made:
        yield made


@pytest.fixture
def model(timed: Services, model_file: Path) -> ModelRow:
    return seeds.imported(timed, model_file, "house", "Ada")


def place(model: ModelRow) -> str:
    return f"/v1/people/{model.person_id}/consent"


async def meeting_with(client: httpx.AsyncClient, model: ModelRow) -> tuple[dict, dict[str, str]]:
    """A meeting in which the model stands, and the header of somebody else who has joined it."""
    asked = {"name": "Monday", "model_ids": [model.id]}
    meeting = (await client.post("/v1/meetings", json=asked)).json()
    joined = await client.post(f"/v1/meetings/{meeting['id']}/join", json={})
    return meeting, {"Authorization": f"Bearer {joined.json()['token']}"}


async def shown(client: httpx.AsyncClient, meeting: dict) -> list[str]:
    read = (await client.get(f"/v1/meetings/{meeting['id']}")).json()
    return [one["name"] for one in read["performers"]]


async def test_who_says_nothing_consents_to_what_is_usual(client: httpx.AsyncClient):
    made = (await client.post("/v1/people", json={"name": "Ada"})).json()
    assert made["consent"] == USUAL | {"revoked_at": None}
    read = await client.get(f"/v1/people/{made['id']}/consent")
    assert (read.status_code, read.json()) == (200, made["consent"])


async def test_a_consent_is_given_with_the_person_and_anew(
    client: httpx.AsyncClient, timed: Services, clock: Clock
):
    until = (clock.now + timedelta(days=3)).isoformat()
    body = {"name": "Ada", "consent": {"purposes": ["driving", "meetings"], "until": until}}
    made = (await client.post("/v1/people", json=body)).json()
    assert made["consent"]["purposes"] == ["meetings", "driving"]
    assert made["consent"]["state"] == "given"
    where = f"/v1/people/{made['id']}/consent"
    clock.advance(minutes=1)
    given = (await client.put(where, json={"purposes": ["meetings"]})).json()
    assert given == USUAL | {"purposes": ["meetings"], "revoked_at": None}
    clock.advance(minutes=1)
    revoked = (await client.delete(where)).json()
    assert revoked["state"] == "revoked"
    assert revoked["revoked_at"] is not None
    clock.advance(minutes=1)
    assert (await client.delete(where)).json() == revoked  # once is enough
    assert (await client.put(where, json={"purposes": []})).json()["state"] == "given"
    with timed.reading() as unit:
        events = unit.audit.of_account("house")
    assert [event.action for event in events] == [
        "person.added",
        "consent.given",
        "consent.revoked",
        "consent.given",
    ]
    assert {event.person_id for event in events} == {made["id"]}
    first, given, *_ = (event.details for event in events)
    assert first["consent"]["purposes"] == ["meetings", "driving"]
    assert first["consent"]["until"] is not None
    assert given == {"purposes": ["meetings"], "until": None}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"purposes": ["meetings"], "until": "2020-01-01T00:00:00Z"}, "in the next hundred years"),
        ({"purposes": ["meetings"], "until": "9999-12-31T23:59:59-12:00"}, "give a later day"),
        ({"purposes": ["meetings"], "until": "2030-01-01T00:00:00"}, "body.until"),
        ({"purposes": ["advertising"]}, "body.purposes.0"),
        ({}, "body.purposes"),
    ],
)
async def test_what_is_no_consent_is_said(client, model, body: dict, words: str):
    answer = await client.put(place(model), json=body)
    assert answer.status_code == 422
    assert words in answer.json()["detail"]
    assert (await client.get(place(model))).json()["purposes"] == USUAL["purposes"]


@pytest.mark.parametrize("how", ["revoked", "ended", "not for meetings"])
async def test_whose_consent_does_not_hold_is_seated_and_shown_nowhere(
    client: httpx.AsyncClient, clock: Clock, model: ModelRow, how: str
):
    meeting, seat = await meeting_with(client, model)
    viewer_file = f"/v1/models/{model.id}/files/viewer.splats"
    assert (await client.get(viewer_file, headers=seat)).status_code == 200
    until = (clock.now + timedelta(seconds=10)).isoformat()
    if how == "revoked":
        assert (await client.delete(place(model))).status_code == 200
    elif how == "ended":
        await client.put(place(model), json={"purposes": ["meetings"], "until": until})
        assert await shown(client, meeting) == ["Ada"]
        clock.advance(seconds=10)
        assert (await client.get(place(model))).json()["state"] == "ended"
    else:
        await client.put(place(model), json={"purposes": ["recordings"]})
    assert await shown(client, meeting) == []
    joined = (await client.post(f"/v1/meetings/{meeting['id']}/join", json={})).json()
    assert joined["performers"] == []
    etag = {"If-None-Match": '"whatever the browser kept"'}
    for answer in (
        await client.get(viewer_file, headers=seat),
        await client.get(viewer_file, headers=seat | etag),
        await client.post("/v1/meetings", json={"name": "Tuesday", "model_ids": [model.id]}),
        await client.post(f"/v1/meetings/{meeting['id']}/performers", json={"model_id": model.id}),
    ):
        assert answer.status_code == 403
        assert answer.json()["type"] == "urn:metanerf:no-consent"
        detail = answer.json()["detail"]
        assert "must consent to meetings; got Ada, whose consent" in detail
        assert {"revoked": "was revoked at", "ended": "ended at"}.get(how, "is for") in detail
        assert "PUT /v1/people/{id}/consent" in detail
    # the owner's own pictures are theirs
    assert (await client.get(viewer_file)).status_code == 200
    await client.put(place(model), json={"purposes": ["meetings"]})
    assert await shown(client, meeting) == ["Ada"]
    assert (await client.get(viewer_file, headers=seat)).status_code == 200


async def test_a_browser_asks_each_time_whether_it_may_use_what_it_kept(client, model):
    _, seat = await meeting_with(client, model)
    path = f"/v1/models/{model.id}/files/viewer.splats"
    first = await client.get(path, headers=seat)
    assert first.headers["cache-control"] == "private, no-cache"
    kept = seat | {"If-None-Match": first.headers["etag"]}
    assert (await client.get(path, headers=kept)).status_code == 304
    await client.delete(place(model))
    assert (await client.get(path, headers=kept)).status_code == 403


async def test_whoever_may_drive_is_told_so(client, timed: Services, model: ModelRow, model_file):
    meeting, _ = await meeting_with(client, model)
    demo = import_model(timed, model_file, GUEST, "Robin")
    guest = bearer(timed, "guest-bo")
    robins = (
        await client.post(
            "/v1/meetings", json={"name": "Demo", "model_ids": [demo.id]}, headers=guest
        )
    ).json()

    async def drivable(meeting_id: str, headers: dict[str, str] | None = None) -> list[bool]:
        read = await client.get(f"/v1/meetings/{meeting_id}", headers=headers)
        return [one["drivable"] for one in read.json()["performers"]]

    assert await drivable(robins["id"], guest) == [True]
    assert await drivable(robins["id"]) == [False]  # what the demo lends is for guests
    assert await drivable(meeting["id"]) == [True]
    assert await drivable(meeting["id"], guest) == [False]
    await client.put(place(model), json={"purposes": ["meetings", "driving"]})
    assert await drivable(meeting["id"], guest) == [True]
