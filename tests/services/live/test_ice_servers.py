"""Relays: what browsers are given, and a viewer who sees by one alone."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import httpx
import pytest
from aioice.turn import create_turn_endpoint
from aiortc import RTCConfiguration, RTCIceServer, RTCIceTransportPolicy
from pydantic import SecretStr

from services.app import create_app
from services.container import Services
from services.gateway import gateway_of
from services.live.ice_servers import IceServer, ice_servers
from services.settings import Settings, load_settings
from tests.servers import TurnServer
from tests.services import seeds
from tests.services.conftest import bearer, changed
from tests.services.live.test_whep import open_meeting
from tests.services.live.viewer import Viewer, view

SECRET = "north star"


def settings_with(turn_url: str, secret: str, services: Services) -> Settings:
    return changed(services.settings, turn_urls=[turn_url], turn_secret=SecretStr(secret))


def test_credentials_are_those_of_the_turn_rest_scheme():
    settings = load_settings(
        ice_servers=["stun:example.org"],
        turn_urls=["turn:example.org", "turn:example.org?transport=tcp"],
        turn_secret=SECRET,
    ).live
    given = ice_servers(settings, "ada", datetime.fromtimestamp(1_700_000_000, UTC))
    # printf %s 1700043200:ada | openssl dgst -sha1 -hmac "north star" -binary | base64
    assert given == [
        IceServer(["stun:example.org"]),
        IceServer(
            ["turn:example.org", "turn:example.org?transport=tcp"],
            "1700043200:ada",
            "f22vb5xMpHWVwTCBnkbNLXkWtck=",
        ),
    ]
    assert "f22vb5xMpHWVwTCBnkbNLXkWtck=" not in repr(given)


def test_without_a_secret_there_are_no_relays():
    assert ice_servers(load_settings().live, "ada", datetime.now(UTC)) == []


async def test_whoever_joins_or_connects_gets_them_and_no_log_does(
    services: Services, model_file, caplog: pytest.LogCaptureFixture
):
    caplog.set_level(logging.DEBUG)
    settings = settings_with("turn:example.org", SECRET, services)
    app = create_app(replace(services, settings=settings))
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(
        transport=transport, base_url="http://test", headers=bearer(services)
    ) as caller:
        model = seeds.imported(services, model_file, "house", "Ada")
        meeting = (
            await caller.post("/v1/meetings", json={"name": "Monday", "model_ids": [model.id]})
        ).json()
        seat = (await caller.post(f"/v1/meetings/{meeting['id']}/join", json={})).json()
        viewer = Viewer()
        header = {"Authorization": f"Bearer {seat['token']}"}
        answer = await viewer.look(caller, meeting["id"], header)
    [relay] = seat["ice_servers"]
    expiry, holder = relay["username"].split(":")
    assert holder == seat["participant_id"]
    assert 11 * 3600 < int(expiry) - time.time() < 13 * 3600
    link = answer.headers["link"]
    assert link.startswith('<turn:example.org>; rel="ice-server"; username="')
    assert link.endswith('"; credential-type="password"')
    linked = link.partition('credential="')[2].partition('"')[0]
    for secret in (SECRET, relay["credential"], linked):
        assert secret
        assert secret not in caplog.text
    await viewer.peer.close()
    await gateway_of(app).close()


@pytest.mark.parametrize("transport", ["udp", "tcp", "tls"])
async def test_a_viewer_who_has_only_a_relay_sees(
    services: Services,
    model_file,
    turn_server: TurnServer,
    transport: str,
    monkeypatch: pytest.MonkeyPatch,
):
    by_tls = transport == "tls"
    url = turn_server.tls_url if by_tls else f"{turn_server.url}?transport={transport}"
    monkeypatch.setenv("SSL_CERT_FILE", str(turn_server.certificate))
    settings = settings_with(url, turn_server.secret, services)
    app = create_app(replace(services, settings=settings))
    async with httpx.AsyncClient(
        transport=httpx.ASGITransport(app), base_url="http://test", headers=bearer(services)
    ) as caller:
        model = seeds.imported(services, model_file, "house", "Ada")
        meeting_id, header = await open_meeting(caller, model)
        seat = await caller.post(f"/v1/meetings/{meeting_id}/join", json={})
        [relay] = seat.json()["ice_servers"]
        viewer = Viewer(relayed(relay))
        assert (await viewer.look(caller, meeting_id, header)).status_code == 201
        offered = viewer.peer.localDescription.sdp
        kinds = {
            line.split(" typ ")[1].split()[0] for line in offered.splitlines() if "typ" in line
        }
        assert kinds == {"relay"}
        await viewer.opened()
        viewer.channel.send(view(1, 0.0, 3.0))
        assert (await viewer.frame()).std() > 5
        await viewer.peer.close()
    await gateway_of(app).close()


async def test_a_viewer_takes_no_relay_by_tls_that_nobody_vouches_for(
    services: Services, turn_server: TurnServer
):
    settings = settings_with(turn_server.tls_url, turn_server.secret, services)
    [relay] = ice_servers(settings.live, "ada", datetime.now(UTC))
    given = {"urls": relay.urls, "username": relay.username, "credential": relay.credential}
    viewer = Viewer(relayed(given))
    assert "typ relay" not in await viewer.offer()
    await viewer.peer.close()


@pytest.mark.parametrize(("secret", "age_s"), [("another secret", 0), (None, 86_400)])
async def test_the_turn_server_refuses_credentials_of_another_secret_and_old_ones(
    services: Services, turn_server: TurnServer, secret: str | None, age_s: int
):
    settings = settings_with(turn_server.url, secret or turn_server.secret, services)
    made_at = datetime.fromtimestamp(time.time() - age_s, UTC)
    [refused] = ice_servers(settings.live, "ada", made_at)
    viewer = Viewer(
        relayed(
            {"urls": refused.urls, "username": refused.username, "credential": refused.credential}
        )
    )
    assert "typ relay" not in await viewer.offer()
    await viewer.peer.close()


async def test_the_turn_server_relays_to_the_gateway_and_to_nobody_else(
    services: Services, turn_server: TurnServer
):
    settings = settings_with(turn_server.url, turn_server.secret, services)
    [relay] = ice_servers(settings.live, "ada", datetime.now(UTC))
    refused: asyncio.Future[Exception] = asyncio.get_running_loop().create_future()

    class Peer(asyncio.DatagramProtocol):
        def error_received(self, exc: Exception) -> None:
            refused.set_result(exc)

    host, port = turn_server.url.removeprefix("turn:").split(":")
    transport, _ = await create_turn_endpoint(
        Peer, (host, int(port)), relay.username, relay.credential
    )
    transport.sendto(b"PING", ("10.0.0.9", 6379))  # somebody's Redis
    assert "403" in str(await asyncio.wait_for(refused, 5.0))
    transport.close()


def relayed(server: dict[str, Any]) -> RTCConfiguration:
    """A configuration that uses no candidate but a relay's."""
    return RTCConfiguration(
        iceServers=[RTCIceServer(**server)], iceTransportPolicy=RTCIceTransportPolicy.RELAY
    )
