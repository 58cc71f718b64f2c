"""The figures are for the operator, not for the world."""

from __future__ import annotations

from dataclasses import replace

import httpx
import pytest
from pydantic import SecretStr

from scene.errors import InvalidInput
from services.app import create_app
from services.container import Services
from services.settings import load_settings
from tests.services.conftest import bearer, changed

TOKEN = "7Hq2vLw9sXk4ZtRb"


async def scrape(
    services: Services, address: str, headers: dict[str, str] | None = None
) -> httpx.Response:
    transport = httpx.ASGITransport(create_app(services), client=(address, 40_000))
    async with httpx.AsyncClient(transport=transport, base_url="http://test") as caller:
        return await caller.get("/metrics", headers=headers)


@pytest.mark.parametrize("address", ["127.0.0.1", "10.1.2.3", "172.18.0.4", "::1", "fd00::2"])
async def test_whoever_is_near_may_look(services: Services, address: str):
    assert (await scrape(services, address)).status_code == 200


@pytest.mark.parametrize("address", ["8.8.8.8", "2001:4860::1", "::ffff:8.8.8.8", "a socket"])
async def test_the_world_may_not(services: Services, address: str):
    answer = await scrape(services, address)
    assert answer.status_code == 403
    assert "METANERF_METRICS_TOKEN" in answer.json()["detail"]
    # an account's token is no key to the operator's figures
    assert (await scrape(services, address, bearer(services))).status_code == 403


@pytest.mark.parametrize("header", ["X-Forwarded-For", "Forwarded", "Via", "X-Real-IP"])
async def test_what_comes_by_a_proxy_is_the_worlds(services: Services, header: str):
    answer = await scrape(services, "127.0.0.1", {header: "127.0.0.1"})
    assert answer.status_code == 403


async def test_where_there_is_a_token_it_alone_counts(services: Services):
    keyed = replace(services, settings=changed(services.settings, metrics_token=SecretStr(TOKEN)))
    with_token = {"Authorization": f"Bearer {TOKEN}"}
    assert (await scrape(keyed, "8.8.8.8", with_token)).status_code == 200
    for wrong in ({}, {"Authorization": f"Bearer {TOKEN}x"}, {"Authorization": TOKEN}):
        refused = await scrape(keyed, "127.0.0.1", wrong)
        assert (refused.status_code, refused.headers["www-authenticate"]) == (401, "Bearer")
        assert TOKEN not in refused.text


def test_a_token_that_can_be_guessed_is_refused():
    with pytest.raises(InvalidInput, match="METANERF_METRICS_TOKEN"):
        load_settings(metrics_token="short")
