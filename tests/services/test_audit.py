"""Whatever changes who may do what, and whatever is refused, is in the audit log."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
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
from services.gateway import gateway_of
from services.limits import RateLimit
from services.logs import meeting_digest
from tests.services.api.authorisation_world import ADA, Caller, World
from tests.services.api.conftest import world as world
from tests.services.api.conftest import world_folder as world_folder
from tests.services.api.conftest import world_services as world_services
from tests.services.control.conftest import on_a_port
from tests.services.control.page import Page
from tests.services.live.viewer import Viewer


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


async def refused_so_far(services: Services, many: int) -> list[tuple[str, str]]:
    """Account and route of each refusal, once there are so many; they are noted a moment later."""
    async with asyncio.timeout(20.0):
        while len(found := [one for one in told(services) if one[0] == "access.refused"]) < many:
            await asyncio.sleep(0.02)
    return [(account, f"{details['route']}: {details['error']}") for _, account, details in found]


async def test_what_the_control_channel_refuses_is_told(
    app: FastAPI, services: Services, world: World
):
    meeting_id = world.ada.params["meeting_id"]
    channel = "WS /v1/meetings/{meeting_id}/control"
    async with on_a_port(app, services) as caller:
        url = str(caller.base_url).replace("http", "ws", 1) + f"/v1/meetings/{meeting_id}/control"
        for token in ("guessed", world.tokens[Caller.ELSEWHERE]):
            async with Page(url, token, "Eve") as eve:
                assert (await eve.gone())["reason"] == "refused"
        async with Page(url, world.tokens[Caller.SPEAKER], "Bo") as bo:
            await bo.hear("welcome")
            await bo.say(type="end")
            await bo.hear("refusal")
            # what is not known, or not so, is no attempt at what one may not
            await bo.say(type="dance")
            await bo.say(type="say", text="Hello")
            await bo.hear("said", text="Hello")
        elsewhere = services.tokens.read(world.tokens[Caller.ELSEWHERE]).account
        assert sorted(await refused_so_far(services, 3)) == [
            ("", f"{channel}: Unauthorized"),
            (elsewhere, f"{channel}: OtherMeeting"),
            ("guest-sp", f"{channel} end: HostCommand"),
        ]
    assert meeting_id not in str(told(services))


async def test_what_is_driven_by_who_may_not_is_told(
    app: FastAPI, services: Services, world: World
):
    views, meeting_id = gateway_of(app).views, world.ada.params["meeting_id"]
    viewer, heard = Viewer(), []
    channel = viewer.peer.createDataChannel("motion", protocol=world.ada.params["performer_id"])
    channel.on("message", heard.append)
    _, answer = await views.open(meeting_id, await viewer.offer(), None, "guest-sp")
    await viewer.accept(answer)
    assert await refused_so_far(services, 1) == [("guest-sp", "channel motion: NotOwner")]
    await viewer.peer.close()
    await gateway_of(app).close()


async def test_whoever_guesses_tokens_on_the_control_channel_is_stopped(
    services: Services, world: World
):
    limit = RateLimit("requests from one address", 2, services.clock)
    limited = replace(services, address_limit=limit)
    app = create_app(limited)
    async with on_a_port(app, limited) as caller:
        url = str(caller.base_url).replace("http", "ws", 1) + "/v1/meetings/any/control"
        said = []
        for _ in range(3):
            async with Page(url, "guessed", "Eve") as eve:
                said.append((await eve.gone())["problem"]["status"])
    assert said == [401, 401, 429]


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
