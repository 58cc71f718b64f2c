"""Every route, WebSocket and data channel answers every caller as the matrix says, own or not."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from sqlalchemy import select

from db.errors import NotFound
from db.models import AuditEventRow, Base
from services.app import ROUTERS, create_app
from services.container import Services
from services.errors import NotOwner
from services.gateway import gateway_of
from services.live.motion.driving_channels import drivable_performer, owns_alone
from tests.services.api.authorisation_matrix import (
    CONTROL,
    CONTROL_ANSWERS,
    DRIVING,
    OK,
    ROWS,
    Row,
)
from tests.services.api.authorisation_world import Belongings, Caller, World
from tests.services.control.conftest import on_a_port
from tests.services.control.page import Page


@pytest.fixture
def services(world_services: Services) -> Services:
    return world_services


@pytest.fixture
async def app(services: Services) -> FastAPI:
    return create_app(services)


@pytest.fixture
async def nobody(app: FastAPI) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://test") as made:
        yield made


def _routes(app: FastAPI) -> set[str]:
    """Every route: those of the routers, and what the application has beside them."""
    beside = [one for one in app.routes if getattr(one, "path", None) is not None]
    assert len(app.routes) - len(beside) == len(ROUTERS), "a router that services.app doesn't list"
    found: set[str] = set()
    for route in [*beside, *(one for router in ROUTERS for one in router.routes)]:
        methods: set[str] = getattr(route, "methods", None) or {"WS"}
        if "GET" in methods:
            methods = methods - {"HEAD"}
        path: str = vars(route)["path"]
        found |= {f"{method} {path}" for method in methods}
    return found


async def test_every_route_has_its_row(app: FastAPI):
    assert sorted(row.route for row in ROWS) == sorted(_routes(app) - {CONTROL})
    assert CONTROL in _routes(app)


def _filled(value: Any, owner: Belongings) -> Any:
    """A request with ids in the place of their names."""
    if isinstance(value, str):
        return owner.path(value)
    if isinstance(value, dict):
        return {key: _filled(one, owner) for key, one in value.items()}
    return value


def _stored(services: Services) -> dict[str, list[Any]]:
    """Every row of every table, but for what the audit log tells of refusals."""
    with services.database.engine.connect() as connection:
        return {
            table.name: sorted(map(repr, connection.execute(select(table))))
            for table in Base.metadata.sorted_tables
            if table.name != AuditEventRow.__tablename__
        }


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.route)
async def test_a_route_answers_each_caller_as_it_should(
    nobody: httpx.AsyncClient, services: Services, world: World, row: Row
):
    method, template = row.route.split()

    async def status(caller: Caller, owner: Belongings) -> int:
        request = _filled(row.request, owner)
        headers = world.headers(caller) | request.pop("headers", {})
        path = owner.path(row.path or template)
        return (await nobody.request(method, path, headers=headers, **request)).status_code

    told, expected = {}, {}
    asked = [
        (caller, name, owner, wanted)
        for name, owner, answers in (
            ("own", world.ada, row.answers.own),
            ("foreign", world.cy, row.answers.foreign),
        )
        for caller, wanted in answers.items()
    ]
    before, objects = _stored(services), services.objects
    owners = (world.ada.params["person_id"], world.cy.params["person_id"])
    kept = {info for owner in owners for info in objects.list(owner)}
    # those who are refused first: they must have changed nothing
    for refused in (True, False):
        for caller, name, owner, wanted in asked:
            if (wanted != OK) is refused:
                told[caller, name] = await status(caller, owner)
                expected[caller, name] = row.ok if wanted == OK else wanted
        if refused:
            assert told == expected
            assert _stored(services) == before
            assert {info for owner in owners for info in objects.list(owner)} == kept
    assert told == expected


async def test_the_control_channel_takes_seats_of_its_meeting(
    app: FastAPI, services: Services, world: World
):
    told, expected = {}, {}
    async with on_a_port(app, services) as caller:
        base = f"{caller.base_url!s}".replace("http", "ws", 1).rstrip("/")
        for name, owner, answers in (
            ("own", world.ada, CONTROL_ANSWERS.own),
            ("foreign", world.cy, CONTROL_ANSWERS.foreign),
        ):
            url = base + owner.path(CONTROL.split()[1])
            for who, wanted in answers.items():
                async with Page(url, world.tokens[who], who.value) as page:
                    await page.until(lambda page=page: bool(page.heard), "an answer")
                    first = page.heard[0]
                welcome = first["type"] == "welcome"
                told[who, name] = OK if welcome else first["problem"]["status"]
                expected[who, name] = wanted
    assert told == expected


async def test_who_was_sent_out_hears_so_on_the_channel_and_nothing_else(
    app: FastAPI, services: Services, world: World
):
    async with on_a_port(app, services) as caller:
        base = f"{caller.base_url!s}".replace("http", "ws", 1).rstrip("/")
        url = base + world.ada.path(CONTROL.split()[1])
        async with Page(url, world.tokens[Caller.REMOVED], "removed") as page:
            assert (await page.gone())["reason"] == "removed"
            assert [message["type"] for message in page.heard] == ["welcome", "goodbye"]


async def test_the_data_channel_of_keypoints_drives_ones_own_and_pictures_show_it(
    app: FastAPI, services: Services, world: World
):
    views, told, shown, expected = gateway_of(app).views, {}, {}, {}
    for name, owner, answers in (
        ("own", world.ada, DRIVING.own),
        ("foreign", world.cy, DRIVING.foreign),
    ):
        room = await views.room(owner.params["meeting_id"])
        for who, wanted in answers.items():
            account = _account(services, world.tokens[who])
            try:
                drivable_performer(room, account, owner.params["performer_id"])
                told[who, name] = OK
            except NotOwner:
                told[who, name] = 403
            with pytest.raises(NotFound):
                drivable_performer(room, account, "nobody")
            mine = any(
                owns_alone(account, one)
                for one in room.performers
                if one.performer_id == owner.params["performer_id"]
            )
            shown[who, name] = OK if mine else 403
            expected[who, name] = wanted
    assert told == expected
    assert shown == expected


def _account(services: Services, token: str) -> str | None:
    """Whose connection it was: one goes on when its token ends."""
    return services.tokens.guest_of(token) or services.tokens.read(token).account if token else None
