"""Two gateways at addresses of their own: all of a meeting come to one, and leave it together."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace

import httpx
import pytest
from fastapi import FastAPI

from services.app import create_app
from services.container import Services
from services.gateway import Gateway, gateway_of
from services.homes import LEASE_S
from tests.fakes import Clock
from tests.servers import free_port
from tests.services import seeds
from tests.services.conftest import changed
from tests.services.control.conftest import on_a_port
from tests.services.control.page import Page, join
from tests.services.control.test_voices import Headset
from tests.services.live.viewer import Viewer

SDP = {"content-type": "application/sdp"}


@dataclass(frozen=True)
class Served:
    """One of the two."""

    url: str
    gateway: Gateway
    caller: httpx.AsyncClient


@pytest.fixture
async def gateways(timed: Services) -> AsyncIterator[list[Served]]:
    async with AsyncExitStack() as stack:
        made = []
        for _ in range(2):
            port = free_port()
            settings = changed(timed.settings, gateway_url=f"http://127.0.0.1:{port}")
            own = replace(timed, settings=settings)
            app: FastAPI = create_app(own)
            caller = await stack.enter_async_context(on_a_port(app, own, port))
            made.append(Served(settings.server.gateway_url, gateway_of(app), caller))
        for _ in range(2):  # in the second round, each knows of the other
            for one in made:
                one.gateway.homes.renew()
        yield made


@dataclass(frozen=True)
class Seat:
    """What joining gave."""

    meeting_id: str
    gateway_url: str
    token: str

    @property
    def header(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.token}"}

    def page(self, url: str, name: str) -> Page:
        socket = f"{url.replace('http', 'ws', 1)}/v1/meetings/{self.meeting_id}/control"
        return Page(socket, self.token, name)


async def take_seat(at: Served, meeting_id: str) -> Seat:
    answer = await at.caller.post(f"/v1/meetings/{meeting_id}/join", json={})
    told = answer.json()
    assert told["whep_url"] == f"{told['gateway_url']}/whep/{meeting_id}"
    assert told["control_url"] == f"{told['gateway_url']}/v1/meetings/{meeting_id}/control"
    return Seat(meeting_id, told["gateway_url"], told["token"])


@pytest.fixture
async def meeting_id(gateways: list[Served], timed: Services, model_file) -> str:
    """With somebody to be seen in it."""
    model = seeds.imported(timed, model_file, "house", "Robin")
    body = {"name": "Monday", "model_ids": [model.id]}
    return (await gateways[0].caller.post("/v1/meetings", json=body)).json()["id"]


def sorted_by_home(gateways: list[Served], url: str) -> list[Served]:
    """The home first."""
    return sorted(gateways, key=lambda one: one.url != url)


async def test_whoever_asks_elsewhere_is_sent_home(gateways: list[Served], meeting_id: str):
    seats = [await take_seat(one, meeting_id) for one in gateways]
    assert seats[0].gateway_url == seats[1].gateway_url
    home, other = sorted_by_home(gateways, seats[0].gateway_url)
    for one in gateways:
        found = await one.caller.get(f"/v1/meetings/{meeting_id}/home", headers=seats[0].header)
        assert found.json() == {"gateway_url": home.url}
    paths = (f"/whep/{meeting_id}", f"/whip/{meeting_id}", f"/v1/meetings/{meeting_id}/voice")
    for path in paths:
        offer = {"content": b"v=0", "headers": seats[0].header | SDP}
        sent = await other.caller.post(path, **offer)
        assert sent.status_code == 307, sent.text
        assert sent.headers["location"] == home.url + path
        assert sent.json()["type"] == "urn:metanerf:lives-elsewhere"
    here = await home.caller.post(paths[2], content=b"v=0", headers=seats[0].header | SDP)
    assert here.status_code == 422
    async with seats[0].page(other.url, "Ada") as lost:
        assert (await lost.gone())["reason"] == "moved"
    async with seats[0].page(home.url, "Ada") as ada, seats[1].page(home.url, "Bo") as bo:
        await ada.roster(lambda who: {"Ada", "Bo"} <= who.keys())
        await bo.roster(lambda who: {"Ada", "Bo"} <= who.keys())


async def test_pages_of_gateways_alone_may_come_from_elsewhere(
    gateways: list[Served], meeting_id: str
):
    one, two = gateways
    ask = {
        "access-control-request-method": "POST",
        "access-control-request-headers": "content-type",
    }
    for origin, allowed in ((two.url, True), ("https://else.example", False)):
        answer = await one.caller.options(f"/whep/{meeting_id}", headers=ask | {"origin": origin})
        assert answer.headers.get("access-control-allow-origin") == (origin if allowed else None)
        assert answer.status_code == (200 if allowed else 400)
    read = await one.caller.get("/healthz", headers={"origin": two.url})
    assert "Location" in read.headers["access-control-expose-headers"]


async def test_a_meeting_whose_home_died_goes_on_with_the_next_who_asks(
    gateways: list[Served], meeting_id: str, clock: Clock
):
    seat = await take_seat(gateways[0], meeting_id)
    _, other = sorted_by_home(gateways, seat.gateway_url)
    clock.advance(seconds=LEASE_S + 0.1)
    other.gateway.homes.renew()
    found = await other.caller.get(f"/v1/meetings/{meeting_id}/home", headers=seat.header)
    assert found.json() == {"gateway_url": other.url}
    async with seat.page(other.url, "Ada") as ada:
        await ada.hear("welcome")


async def test_a_gateway_that_drains_sends_everybody_away_and_takes_nobody(
    gateways: list[Served], meeting_id: str
):
    seat = await take_seat(gateways[0], meeting_id)
    home, other = sorted_by_home(gateways, seat.gateway_url)
    viewer, voice = Viewer(), Headset(tone=False)
    async with seat.page(home.url, "Ada") as ada:
        await ada.roster(lambda who: "Ada" in who)
        assert (await viewer.look(home.caller, meeting_id, seat.header)).status_code == 201
        await viewer.opened()
        await voice.call(home.caller, meeting_id, seat.header)
        async with asyncio.timeout(20.0):
            await home.gateway.drain(60.0)
        assert (await ada.gone())["reason"] == "moved"
    assert [len(one) for one in (home.gateway.views, home.gateway.voices)] == [0, 0]
    ready = await home.caller.get("/readyz")
    assert (ready.status_code, ready.json()["status"]) == (503, "unready")
    assert "drains" in ready.json()["checks"]["gateway"]
    assert (await other.caller.get("/readyz")).status_code == 200
    for one in gateways:
        found = await one.caller.get(f"/v1/meetings/{meeting_id}/home", headers=seat.header)
        assert found.json() == {"gateway_url": other.url}
    refused = await home.caller.post(
        f"/whep/{meeting_id}", content=b"v=0", headers=seat.header | SDP
    )
    assert refused.headers["location"] == f"{other.url}/whep/{meeting_id}"
    again = Viewer()
    async with seat.page(other.url, "Ada") as back:
        await back.roster(lambda who: "Ada" in who)
        assert (await again.look(other.caller, meeting_id, seat.header)).status_code == 201
        await again.opened()
    for peer in (viewer.peer, voice.peer, again.peer):
        await peer.close()


async def test_a_lone_gateway_that_drains_asks_for_patience(
    app: FastAPI, caller: httpx.AsyncClient, meeting: dict
):
    async with await join(caller, meeting["id"], "Ada") as ada:
        await ada.roster(lambda who: "Ada" in who)
        async with asyncio.timeout(20.0):
            await gateway_of(app).drain(60.0)
        assert (await ada.gone())["reason"] == "moved"
        async with Page(ada.url, ada.token, "Ada") as again:
            assert (await again.gone())["problem"]["type"] == "urn:metanerf:draining"
    for method, what in (("POST", "join"), ("GET", "home")):
        answer = await caller.request(method, f"/v1/meetings/{meeting['id']}/{what}", json={})
        assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")


async def test_draining_ends_at_its_deadline_where_nobody_goes(
    gateways: list[Served], meeting_id: str, monkeypatch: pytest.MonkeyPatch
):
    seat = await take_seat(gateways[0], meeting_id)
    home, _ = sorted_by_home(gateways, seat.gateway_url)
    async with seat.page(home.url, "Ada") as ada:
        await ada.roster(lambda who: "Ada" in who)
        await home.gateway.drain(0.0)
        assert len(home.gateway.hub) == 1
