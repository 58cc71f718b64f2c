"""Limits by caller: so many at once, then one at a time, and never the neighbour's fault."""

from __future__ import annotations

import httpx
import pytest

from services.app import create_app
from services.composition import build_services
from services.errors import TooManyRequests
from services.limits import RateLimit, network_of
from services.problems import headers_of, problem_of
from services.settings import Settings
from tests.fakes import Clock
from tests.services.conftest import changed


def test_so_many_a_minute_and_no_more():
    clock = Clock()
    limit = RateLimit("guest tokens", 6, clock)
    for _ in range(6):
        limit.take("a")
    with pytest.raises(
        TooManyRequests, match=r"guest tokens must be at most 6 a minute"
    ) as refused:
        limit.take("a")
    assert problem_of(refused.value).status == 429
    assert headers_of(refused.value) == {"Retry-After": "10"}
    limit.take("b")
    clock.advance(seconds=10)
    limit.take("a")
    with pytest.raises(TooManyRequests):
        limit.take("a")
    clock.advance(seconds=60)
    for _ in range(6):
        limit.take("a")


def test_callers_who_waited_are_forgotten():
    clock = Clock()
    limit = RateLimit("guest tokens", 60, clock)
    for number in range(10_000):
        limit.take(str(number))
    clock.advance(seconds=1)
    limit.take("one more")
    assert len(limit) == 1


@pytest.mark.parametrize(
    ("address", "network"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:aaaa::7", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("testclient", "testclient"),
    ],
)
def test_a_host_is_told_by_its_network(address: str, network: str):
    assert network_of(address) == network


async def test_guests_are_let_in_in_moderation(settings: Settings):
    clock = Clock()
    services = build_services(changed(settings, guest_tokens_per_minute=2), clock=clock)

    def caller(address: str) -> httpx.AsyncClient:
        transport = httpx.ASGITransport(app, client=(address, 1), raise_app_exceptions=False)
        return httpx.AsyncClient(transport=transport, base_url="http://test")

    app = create_app(services)
    async with caller("192.0.2.1") as one, caller("192.0.2.2") as other:
        answers = [await one.post("/v1/guest") for _ in range(3)]
        assert [answer.status_code for answer in answers] == [201, 201, 429]
        refused = answers[-1]
        assert refused.headers["content-type"] == "application/problem+json"
        assert refused.headers["retry-after"] == "30"
        assert "come back in 30 s" in refused.json()["detail"]
        assert (await other.post("/v1/guest")).status_code == 201
        clock.advance(seconds=30)
        assert (await one.post("/v1/guest")).status_code == 201
    services.close()
