"""A gateway in the test's own process, and whoever calls it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import replace

import httpx
import pytest
from fastapi import FastAPI

from services.app import create_app
from services.container import Services
from services.gateway import gateway_of
from services.live.sessions.view_sessions import ViewSessions
from tests.services.conftest import bearer, changed


@pytest.fixture
async def app(services: Services, changes: dict[str, int]) -> AsyncIterator[FastAPI]:
    settings = changed(services.settings, **changes)
    made = create_app(replace(services, settings=settings))
    yield made
    await gateway_of(made).close()


@pytest.fixture
async def caller(app: FastAPI, services: Services) -> AsyncIterator[httpx.AsyncClient]:
    """Account `house`."""
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(
        transport=transport, base_url="http://test", headers=bearer(services)
    ) as client:
        yield client


@pytest.fixture
def views(app: FastAPI) -> ViewSessions:
    return gateway_of(app).views
