"""The proxy, as configured, in front of a real gateway: TLS, WebSockets, events that stay open."""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest

from services.app import create_app
from services.container import Services
from tests.deploy.composed import gateways
from tests.deploy.proxied import CADDYFILE, proxy_to
from tests.servers import free_port, program
from tests.services.conftest import bearer
from tests.services.control.conftest import on_a_port
from tests.services.control.page import join
from tests.services.seeds import queued_training, uploaded

pytestmark = pytest.mark.server


@pytest.fixture
async def proxied(
    services: Services, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[httpx.AsyncClient]:
    """A caller of the gateway by the proxy."""
    async with on_a_port(create_app(services), services) as direct:
        port = direct.base_url.port
        assert port is not None
        ports = dict.fromkeys(gateways(), port)
        places = (tmp_path, free_port(), free_port(), monkeypatch)
        # the gateway serves on this event loop, which must not wait
        opened = proxy_to(ports, *places)
        proxy = await asyncio.to_thread(opened.__enter__)
        try:
            async with httpx.AsyncClient(
                base_url=proxy.url, headers=bearer(services), verify=proxy.trust(), timeout=30.0
            ) as caller:
                yield caller
        finally:
            opened.__exit__(None, None, None)


def test_its_configuration_is_valid(tmp_path: Path):
    command = [program("caddy"), "validate", "--adapter", "caddyfile", "--config", CADDYFILE]
    for domain in ("localhost", "meet.example.org"):
        surroundings = {"HOME": str(tmp_path), "DOMAIN": domain}
        done = subprocess.run(command, env=surroundings, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


async def test_a_meeting_works_through_it(proxied: httpx.AsyncClient, services: Services):
    # what is for the operator is not for the world
    for path in ("/metrics", "/readyz"):
        assert (await proxied.get(path)).status_code == 404
    # the control channel is a WebSocket
    meeting = (await proxied.post("/v1/meetings", json={"name": "Monday"})).json()
    async with await join(proxied, meeting["id"], "Ada") as ada:
        assert ada.url.startswith("wss://localhost:")
        await ada.say(type="say", text="Anybody?")
        await ada.hear("said", text="Anybody?")
    # an event comes while the stream stays open
    job_id = queued_training(services, uploaded(services))
    async with proxied.stream("GET", f"/v1/jobs/{job_id}/events") as stream:
        lines = stream.aiter_lines()
        async with asyncio.timeout(10.0):
            assert '"queued"' in await line_with(lines, "data:")
            await proxied.delete(f"/v1/jobs/{job_id}")
            assert '"cancelled"' in await line_with(lines, "cancelled")


async def line_with(lines: AsyncIterator[str], words: str) -> str:
    """The first line that has these words."""
    async for line in lines:
        if words in line:
            return line
    raise AssertionError(f"the stream ended without {words!r}")
