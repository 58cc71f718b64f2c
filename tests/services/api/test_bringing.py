"""Whoever is invited to somebody's meeting stands in it as themselves, while they are there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import httpx
import pytest

from db.meeting_rows import SEAT_LAPSES_S
from db.models import ModelRow
from services.container import Services
from tests.fakes import Clock
from tests.services import seeds
from tests.services.conftest import bearer


@dataclass
class Caller:
    """Somebody with an account of their own."""

    client: httpx.AsyncClient
    headers: dict[str, str]

    async def post(self, path: str, **body: object) -> httpx.Response:
        return await self.client.post(path, json=body, headers=self.headers)

    async def shown(self, meeting_id: str) -> list[str]:
        """Names of who stands there."""
        answer = await self.client.get(f"/v1/meetings/{meeting_id}", headers=self.headers)
        return [one["name"] for one in answer.json()["performers"]]

    async def bring(self, meeting_id: str, model: ModelRow) -> httpx.Response:
        return await self.post(f"/v1/meetings/{meeting_id}/performers", model_id=model.id)

    async def take_out(self, meeting_id: str, performer_id: str) -> int:
        path = f"/v1/meetings/{meeting_id}/performers/{performer_id}"
        return (await self.client.delete(path, headers=self.headers)).status_code


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def services(services: Services, clock: Clock) -> Services:
    return replace(services, clock=clock)


@pytest.fixture
def ada(client: httpx.AsyncClient, services: Services) -> Caller:
    return Caller(client, bearer(services, "ada"))


@pytest.fixture
def bo(client: httpx.AsyncClient, services: Services) -> Caller:
    return Caller(client, bearer(services, "bo"))


@pytest.fixture
def models(services: Services, model_file: Path) -> dict[str, ModelRow]:
    owners = {"Ada": "ada", "Bo": "bo", "Bo anew": "bo"}
    return {
        name: seeds.imported(services, model_file, owner, name) for name, owner in owners.items()
    }


@pytest.fixture
async def meeting_id(ada: Caller, models: dict[str, ModelRow]) -> str:
    opened = await ada.post("/v1/meetings", name="Monday", model_ids=[models["Ada"].id])
    return opened.json()["id"]


async def join(caller: Caller, meeting_id: str) -> dict:
    return (await caller.post(f"/v1/meetings/{meeting_id}/join", display_name="x")).json()


async def test_who_sits_there_brings_one_of_their_own(
    ada: Caller, bo: Caller, meeting_id: str, models: dict[str, ModelRow]
):
    refused = await bo.bring(meeting_id, models["Bo"])
    assert (refused.status_code, refused.json()["type"]) == (403, "urn:metanerf:not-taking-part")
    assert "join the meeting first" in refused.json()["detail"]
    await join(bo, meeting_id)
    brought = await bo.bring(meeting_id, models["Bo"])
    assert (brought.status_code, brought.json()["owner"]) == (201, "own")
    assert await ada.shown(meeting_id) == await bo.shown(meeting_id) == ["Ada", "Bo"]
    of_others = await bo.bring(meeting_id, models["Ada"])
    assert (of_others.status_code, of_others.json()["type"]) == (403, "urn:metanerf:not-yours")


async def test_the_next_takes_the_place_of_the_one_before(
    ada: Caller, bo: Caller, meeting_id: str, models: dict[str, ModelRow]
):
    await join(bo, meeting_id)
    first = (await bo.bring(meeting_id, models["Bo"])).json()
    second = (await bo.bring(meeting_id, models["Bo anew"])).json()
    assert second["position"] == first["position"]
    assert await ada.shown(meeting_id) == ["Ada", "Bo anew"]
    await ada.bring(meeting_id, models["Ada"])
    assert await ada.shown(meeting_id) == ["Ada", "Bo anew", "Ada"], "hosts bring whom they like"


async def test_who_leaves_is_seen_no_longer_and_makes_room(
    ada: Caller, bo: Caller, meeting_id: str, models: dict[str, ModelRow], clock: Clock
):
    await join(bo, meeting_id)
    await bo.bring(meeting_id, models["Bo"])
    clock.advance(seconds=SEAT_LAPSES_S + 1.0)
    assert await ada.shown(meeting_id) == ["Ada"]
    await join(bo, meeting_id)
    assert await ada.shown(meeting_id) == ["Ada", "Bo"], "who comes back has kept their place"
    clock.advance(seconds=SEAT_LAPSES_S + 1.0)
    await ada.bring(meeting_id, models["Ada"])
    await join(bo, meeting_id)
    assert await ada.shown(meeting_id) == ["Ada", "Ada"], "their place was needed"


async def test_both_they_and_the_host_may_take_them_out(
    ada: Caller, bo: Caller, meeting_id: str, models: dict[str, ModelRow]
):
    await join(bo, meeting_id)
    own = (await ada.client.get(f"/v1/meetings/{meeting_id}", headers=ada.headers)).json()
    (of_ada,) = [one["id"] for one in own["performers"]]
    assert await bo.take_out(meeting_id, of_ada) == 403
    for caller in (bo, ada):
        brought = (await bo.bring(meeting_id, models["Bo"])).json()
        assert await caller.take_out(meeting_id, brought["id"]) == 204
        assert await ada.shown(meeting_id) == ["Ada"]


async def test_who_waits_in_the_lobby_brings_nobody(
    ada: Caller, bo: Caller, models: dict[str, ModelRow]
):
    opened = await ada.post("/v1/meetings", name="Monday", lobby=True)
    await join(bo, opened.json()["id"])
    refused = await bo.bring(opened.json()["id"], models["Bo"])
    assert (refused.status_code, refused.json()["type"]) == (403, "urn:metanerf:not-taking-part")
