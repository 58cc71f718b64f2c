"""The proxy, as configured, in front of a real gateway: TLS, WebSockets, events that stay open."""

from __future__ import annotations

import asyncio
import ssl
import subprocess
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest

from services.app import create_app
from services.container import Services
from tests.deploy.composed import ROOT
from tests.servers import free_port, program
from tests.services.conftest import bearer
from tests.services.control.conftest import on_a_port
from tests.services.control.page import join
from tests.services.seeds import queued_training, uploaded

pytestmark = pytest.mark.server
CADDYFILE = ROOT / "deploy" / "Caddyfile"


@pytest.fixture
async def proxied(
    services: Services, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[httpx.AsyncClient]:
    """A caller of the gateway by the proxy, who trusts the authority that the proxy made itself."""
    caddy, https = program("caddy"), free_port()
    async with on_a_port(create_app(services), services) as direct:
        configuration = tmp_path / "Caddyfile"
        text = CADDYFILE.read_text()
        text = text.replace("{\n", f"{{\n\thttp_port {free_port()}\n", 1)
        configuration.write_text(text.replace("gateway:8000", f"127.0.0.1:{direct.base_url.port}"))
        process = subprocess.Popen(
            [caddy, "run", "--adapter", "caddyfile", "--config", configuration],
            env={"HOME": str(tmp_path), "DOMAIN": f"localhost:{https}"},
            stderr=subprocess.DEVNULL,
        )
        root = tmp_path / ".local/share/caddy/pki/authorities/local/root.crt"
        try:
            async with asyncio.timeout(30.0):
                while not root.exists():
                    assert process.poll() is None, "the proxy ended"
                    await asyncio.sleep(0.05)
            monkeypatch.setenv("SSL_CERT_FILE", str(root))
            async with httpx.AsyncClient(
                base_url=f"https://localhost:{https}",
                headers=bearer(services),
                verify=ssl.create_default_context(cafile=str(root)),
                timeout=30.0,
            ) as caller:
                await answering(caller)
                yield caller
        finally:
            process.terminate()
            process.wait()


async def answering(caller: httpx.AsyncClient) -> None:
    """Return once the proxy has its certificate."""
    async with asyncio.timeout(30.0):
        while True:
            try:
                await caller.get("/healthz")
                return
            except httpx.TransportError:
                await asyncio.sleep(0.1)


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
