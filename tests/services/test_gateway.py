"""One typed place holds what a gateway process shares, and its description leaves nothing out."""

from __future__ import annotations

import asyncio
import gc
import weakref
from pathlib import Path

import httpx
import pytest

from db.erase import erase_person
from services import forgetting
from services.app import ROUTERS, create_app
from services.container import Services
from services.gateway import gateway_of
from tests.services import seeds


async def test_an_application_has_one_gateway_and_nothing_else(services: Services):
    app = create_app(services)
    gateway = gateway_of(app)
    assert list(app.state) == ["gateway"]
    assert gateway.services is services
    await gateway.close()


async def test_a_gateway_forgets_whom_another_has_erased(
    services: Services, model_file: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(forgetting, "LOOK_S", 0.05)
    row = seeds.imported(services, model_file, "house", "Ada")
    gateway = gateway_of(create_app(services))
    kept = weakref.ref(services.models.load(row.id))
    services.models.forget_erased()
    gc.collect()
    assert kept() is not None
    erase_person(services.unit_of_work, services.objects, row.person_id, "house", services.clock())
    gateway.forgetting.start()
    async with asyncio.timeout(30):
        while kept() is not None:
            await asyncio.sleep(0.05)
            gc.collect()
    await gateway.close()


async def test_every_route_stands_in_the_list_of_routers(client: httpx.AsyncClient):
    listed = {getattr(route, "path", None) for router in ROUTERS for route in router.routes}
    described = set((await client.get("/openapi.json")).json()["paths"])
    assert described <= listed
    # a WebSocket, and the page that shows the description
    assert listed - described == {"/v1/meetings/{meeting_id}/control", "/docs"}


async def test_the_description_has_what_travels_on_the_control_channel(client: httpx.AsyncClient):
    document = (await client.get("/openapi.json")).json()
    schemas = document["components"]["schemas"]
    for way, message in (("ToServer", "Hello"), ("FromServer", "Roster")):
        kinds = {choice["$ref"].rpartition("/")[2] for choice in schemas[way]["oneOf"]}
        assert message in kinds
        assert kinds <= set(schemas)
    assert document == (await client.get("/openapi.json")).json()
