"""Limits by caller: so many at once, then one at a time, and never the neighbour's fault."""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager

import httpx
import pytest
import redis

from services.app import create_app
from services.composition import build_services
from services.errors import TooManyRequests
from services.limits import AtOnce, RateLimit, network_of
from services.problems import headers_of, problem_of
from services.redis_counts import RedisCounts
from services.settings import Settings
from tests.fakes import Clock
from tests.servers import MortalRedis
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


def test_so_many_at_once_and_no_more():
    limit = AtOnce("streams", 2)
    with limit.held("a"), limit.held("a"):
        with pytest.raises(TooManyRequests, match="streams must be at most 2 at once"):
            limit.require_room("a")
        limit.require_room("b")
    limit.require_room("a")


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


@contextmanager
def gateways(
    url: str, clock: Clock, per_minute: int = 6, other_clock: Clock | None = None
) -> Iterator[list[RateLimit]]:
    """The same limit in two gateways that share a Redis."""
    counts = [RedisCounts(url) for _ in "ab"]
    what = f"requests {uuid.uuid4().hex}"  # of this test alone
    clocks = (clock, other_clock or clock)
    yield [RateLimit(what, per_minute, *one) for one in zip(clocks, counts, strict=True)]
    for one in counts:
        one.close()


def taken(limit: RateLimit, caller: str, attempts: int) -> int:
    """How many of these were let in."""
    let_in = 0
    for _ in range(attempts):
        try:
            limit.take(caller)
            let_in += 1
        except TooManyRequests:
            pass
    return let_in


def test_gateways_count_together(redis_url: str):
    clock = Clock()
    with gateways(redis_url, clock) as (one, other):
        assert (taken(one, "a", 4), taken(other, "a", 4)) == (4, 2)
        with pytest.raises(TooManyRequests, match="come back in 10 s") as refused:
            other.take("a")
        assert refused.value.retry_after_s == 10
        assert taken(other, "b", 1) == 1
        # whoever waits as long as they were told is let in, by either and once
        clock.advance(seconds=10)
        assert (taken(other, "a", 2), taken(one, "a", 2)) == (1, 0)
        clock.advance(seconds=60)
        assert (taken(other, "a", 3), taken(one, "a", 9)) == (3, 3)


def test_a_gateway_whose_clock_is_ahead_sends_nobody_away_for_long(redis_url: str):
    ahead = Clock()
    ahead.advance(days=30)
    with gateways(redis_url, ahead, other_clock=Clock()) as (one, other):
        assert taken(one, "a", 6) == 6
        with pytest.raises(TooManyRequests) as refused:
            other.take("a")
        assert refused.value.retry_after_s == 10


def test_what_redis_keeps_names_nobody_and_is_gone_in_a_minute(mortal_redis: MortalRedis):
    client = redis.Redis.from_url(mortal_redis.url)
    with gateways(mortal_redis.url, Clock()) as (one, _):
        for _ in range(6):
            one.take("192.0.2.7")
    (key,) = client.keys()
    assert "192.0.2.7" not in str(key)
    assert 55_000 < client.pttl(key) <= 60_000
    client.close()


def test_while_redis_is_away_each_gateway_counts_for_itself(
    mortal_redis: MortalRedis, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    monkeypatch.setattr("services.redis_outage.PAUSE_S", 0.2)
    clock = Clock()
    with gateways(mortal_redis.url, clock) as (one, other):
        assert taken(one, "a", 6) == 6
        mortal_redis.kill()
        with caplog.at_level(logging.WARNING):
            # what one has counted itself it goes on counting
            assert (taken(one, "a", 3), taken(other, "a", 9)) == (0, 6)
            mortal_redis.start()
            time.sleep(0.3)
            clock.advance(seconds=60)
            assert (taken(one, "a", 9), taken(other, "a", 9)) == (6, 0)
    told = [one.getMessage().split(",")[0] for one in caplog.records]
    assert told == ["Redis is away", "Redis is back"]


def test_a_redis_that_hangs_holds_up_whoever_asks_only_for_a_moment(mortal_redis: MortalRedis):
    with gateways(mortal_redis.url, Clock(), 100) as (one, _):
        one.take("a")
        mortal_redis.hang()
        started_s = time.monotonic()
        assert taken(one, "a", 50) == 50
        assert time.monotonic() - started_s < 1.0


async def test_guests_are_let_in_by_all_gateways_together(
    settings: Settings, mortal_redis: MortalRedis
):
    limited = changed(settings, guest_tokens_per_minute=3, redis_url=mortal_redis.url)
    both = [build_services(limited) for _ in "ab"]
    for services in both:
        transport = httpx.ASGITransport(create_app(services), client=("192.0.2.1", 1))
        async with httpx.AsyncClient(transport=transport, base_url="http://test") as caller:
            answers = [(await caller.post("/v1/guest")).status_code for _ in range(2)]
            assert answers == ([201, 201] if services is both[0] else [201, 429])
    for services in both:
        services.close()
