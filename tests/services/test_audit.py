"""Whatever changes who may do what, and whatever is refused, is in the audit log."""

from __future__ import annotations

from collections.abc import AsyncIterator
from datetime import timedelta
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from sqlalchemy import select

from db.models import AuditEventRow, Role
from services.app import create_app
from services.audit import KEEPER
from services.container import Services
from services.control.commands import connect, execute, read_caller
from services.control.messages import EndMeeting, Hello, Leave, Remove, SetRole
from services.logs import meeting_digest
from tests.services.api.authorisation_world import ADA, Caller, World
from tests.services.api.conftest import world as world
from tests.services.api.conftest import world_folder as world_folder
from tests.services.api.conftest import world_services as world_services


@pytest.fixture
def services(world_services: Services) -> Services:
    return world_services


@pytest.fixture
async def nobody(app: FastAPI) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://test") as made:
        yield made


@pytest.fixture
async def app(services: Services) -> FastAPI:
    return create_app(services)


def events(services: Services) -> list[AuditEventRow]:
    """All of them, the oldest first."""
    with services.database.engine.connect() as connection:
        rows = connection.execute(select(AuditEventRow).order_by(AuditEventRow.at)).mappings()
        return [AuditEventRow(**row) for row in rows]


def told(services: Services) -> list[tuple[str, str, Any]]:
    return [(one.action, one.account, one.details) for one in events(services)]


async def test_what_the_owner_does_is_told(
    nobody: httpx.AsyncClient, services: Services, world: World
):
    headers, path = world.headers(Caller.GUEST), world.ada.path
    for method, route in (
        ("POST", "/v1/meetings/{meeting_id}/invitation"),
        ("POST", "/v1/recordings/{recording_id}/export"),
        ("DELETE", "/v1/recordings/{recording_id}/mine"),
        ("DELETE", "/v1/recordings/{recording_id}"),
        ("DELETE", "/v1/people/{person_id}/consent"),
    ):
        body = {} if "export" in route else None
        answer = await nobody.request(method, path(route), headers=headers, json=body)
        assert answer.status_code < 300, answer.text
    actions = [action for action, account, _ in told(services) if account == ADA]
    assert sorted(actions) == [
        "consent.revoked",
        "meeting.invitation_renewed",
        "recording.deleted",
        "recording.exported",
        "recording.left",
    ]
    assert all(world.ada.params["meeting_id"] not in str(one) for one in told(services))
    exported = next(one for one in events(services) if one.action == "recording.exported")
    assert exported.person_id == world.ada.params["person_id"]
    # the event that stays after an erasure names nobody
    assert (await nobody.delete(path("/v1/people/{person_id}"), headers=headers)).status_code == 200
    assert [one.person_id for one in events(services) if one.account == ADA] == [None] * 4
    assert "person.erased" in [one.action for one in events(services)]


async def test_what_is_refused_is_told_with_the_route_and_no_more_than_some(
    nobody: httpx.AsyncClient, services: Services, world: World
):
    route, path = "GET /v1/models/{model_id}", world.cy.path("/v1/models/{model_id}")
    refused = {"route": route, "error": "NotOwner"}
    for _ in range(15):
        assert (await nobody.get(path, headers=world.headers(Caller.GUEST))).status_code == 403
    assert told(services) == [("access.refused", ADA, refused)] * 10
    # one that is not good has no account; one that is missing is no attempt
    await nobody.get(path, headers={"Authorization": "Bearer guessed"})
    await nobody.get(path)
    unknown = [one for one in told(services) if one[1] == ""]
    assert unknown == [("access.refused", "", refused | {"error": "Unauthorized"})]


def test_what_a_host_does_is_told(services: Services, world: World):
    meeting_id = world.ada.params["meeting_id"]
    ids = {}
    for caller in (Caller.HOST, Caller.SPEAKER, Caller.VIEWER):
        hello = Hello(token=world.tokens[caller], name=caller.value)
        principal = read_caller(services, meeting_id, hello)
        ids[caller] = connect(services, meeting_id, principal, hello.name).id
    host, speaker = ids[Caller.HOST], ids[Caller.SPEAKER]
    execute(services, meeting_id, host, Remove(participant_id=ids[Caller.VIEWER]))
    execute(services, meeting_id, host, SetRole(participant_id=speaker, role=Role.HOST))
    execute(services, meeting_id, speaker, SetRole(participant_id=host, role=Role.VIEWER))
    execute(services, meeting_id, speaker, EndMeeting())
    meeting = {"meeting": meeting_digest(meeting_id)}
    expected = [
        ("meeting.ended", "guest-sp", meeting),
        ("meeting.host_changed", "guest-ho", meeting | {"to": "guest-sp"}),
        ("meeting.member_removed", "guest-ho", meeting | {"to": "guest-vi"}),
    ]
    assert sorted(told(services)) == expected


def test_who_comes_as_the_host_where_there_is_none_is_told(services: Services, world: World):
    meeting_id = world.ada.params["meeting_id"]
    seat = services.tokens.read(world.tokens[Caller.HOST]).participant_id
    assert seat is not None
    execute(services, meeting_id, seat, Leave())
    token = world.tokens[Caller.FORMER]
    principal = read_caller(services, meeting_id, Hello(token=token, name="Ada"))
    assert connect(services, meeting_id, principal, "Ada").role is Role.HOST
    meeting = {"meeting": meeting_digest(meeting_id)}
    assert told(services) == [("meeting.host_changed", ADA, meeting | {"to": ADA})]


def test_events_are_forgotten_in_time(services: Services):
    with services.unit_of_work() as unit:
        for days in (1, 3):
            at = services.clock() - timedelta(days=days)
            unit.audit.add(AuditEventRow(at=at, account=KEEPER, action=str(days), details={}))
        assert unit.audit.forget(services.clock() - timedelta(days=2)) == 1
        unit.commit()
    assert [one.action for one in events(services)] == ["1"]
