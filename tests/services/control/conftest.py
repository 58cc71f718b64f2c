"""A gateway on a real port of this event loop, whose clock the tests hold."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

import httpx
import pytest
import uvicorn
from fastapi import FastAPI

from services.app import create_app
from services.container import Services
from services.draining_server import gateway_config
from services.gateway import gateway_of
from tests.fakes import Clock
from tests.services.conftest import bearer


@asynccontextmanager
async def on_a_port(
    app: FastAPI, services: Services, port: int = 0
) -> AsyncIterator[httpx.AsyncClient]:
    """A caller of account `house` of a server that is up."""
    server = uvicorn.Server(gateway_config(app, port=port, lifespan="off"))
    serving = asyncio.create_task(server.serve())
    while not server.started:
        assert not serving.done(), "the server did not start"
        await asyncio.sleep(0.01)
    bound = server.servers[0].sockets[0].getsockname()[1]
    try:
        async with httpx.AsyncClient(
            base_url=f"http://127.0.0.1:{bound}", headers=bearer(services), timeout=60.0
        ) as caller:
            yield caller
    finally:
        server.should_exit = True
        await serving
        await gateway_of(app).close()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def timed(services: Services, clock: Clock) -> Services:
    """The services, by the tests' clock: tokens too."""
    from services.auth import Tokens

    tokens = Tokens(services.settings.signing_keys(), clock)
    return replace(services, clock=clock, tokens=tokens)


@pytest.fixture
async def app(timed: Services) -> FastAPI:
    return create_app(timed)


@pytest.fixture
async def caller(app: FastAPI, timed: Services) -> AsyncIterator[httpx.AsyncClient]:
    async with on_a_port(app, timed) as client:
        yield client


@pytest.fixture
async def meeting(caller: httpx.AsyncClient) -> dict:
    """An empty meeting of account `house`."""
    return (await caller.post("/v1/meetings", json={"name": "Monday"})).json()
