"""Login by a real OpenID provider over HTTP, in a browser with cookies of its own."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from services.app import create_app
from services.composition import build_services
from services.container import Services
from services.settings import Settings, load_settings
from tests.fakes import Clock
from tests.services.openid_provider import (
    CLIENT_ID,
    CLIENT_SECRET,
    OpenIdProvider,
    running_provider,
    ways,
)

HTML = {"Accept": "text/html,application/xhtml+xml"}
BASE = "http://meet.test"


@pytest.fixture(scope="module")
def running() -> Iterator[OpenIdProvider]:
    with running_provider() as made:
        yield made


@pytest.fixture
def provider(running: OpenIdProvider) -> OpenIdProvider:
    """It behaves, at first."""
    fresh = OpenIdProvider(running.issuer, running.keys)
    vars(running).update(vars(fresh))
    return running


@pytest.fixture
def settings_with_login(settings: Settings, provider: OpenIdProvider) -> Settings:
    login = load_settings(
        oidc_issuer=provider.issuer, oidc_client_id=CLIENT_ID, oidc_client_secret=CLIENT_SECRET
    ).login
    return replace(settings, login=login)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def services(
    settings_with_login: Settings, empty_database: Path, clock: Clock
) -> Iterator[Services]:
    made = build_services(settings_with_login, clock=clock)
    shutil.copy(empty_database, settings_with_login.folders.data_dir / "metanerf.db")
    yield made
    made.close()


def browser(services: Services, base_url: str = BASE) -> httpx.AsyncClient:
    """With cookies of its own, and no token."""
    transport = httpx.ASGITransport(create_app(services), raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url=base_url)


@pytest.fixture
async def ada(services: Services) -> AsyncIterator[httpx.AsyncClient]:
    async with browser(services) as made:
        yield made


async def leave_for(client: httpx.AsyncClient, choice: str = "As Ada", to: str = "/") -> str:
    """To the provider, where `choice` is chosen: the address to which it sends the browser."""
    away = await client.get("/v1/login", params={"to": to})
    assert away.status_code == 302, away.text
    decided = httpx.get(ways(away.headers["location"])[choice])
    return decided.headers["location"]


async def come_back(client: httpx.AsyncClient, address: str, **headers: str) -> httpx.Response:
    return await client.get(address, headers=headers)


async def log_in(client: httpx.AsyncClient, choice: str = "As Ada") -> dict[str, Any]:
    """All of it; what the page then gets."""
    back = await come_back(client, await leave_for(client, choice))
    assert (back.status_code, back.headers["location"]) == (302, "/#login=done")
    given = await client.post("/v1/login/token")
    assert given.status_code == 200, given.text
    client.headers["Authorization"] = f"Bearer {given.json()['token']}"
    return given.json()
