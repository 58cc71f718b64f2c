"""Up, ready, counted, described; and what is away is named."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import httpx
import pytest
from obstore.store import MemoryStore

from db.unit_of_work import Database
from services import readiness
from services.app import create_app
from services.container import Services
from services.jobs.redis_events import RedisEvents
from tests.fakes import AwayObjects
from tests.services.conftest import bearer, changed


def _caller(services: Services) -> httpx.AsyncClient:
    transport = httpx.ASGITransport(create_app(services), raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url="http://test", headers=bearer(services))


async def test_up_and_ready(client: httpx.AsyncClient):
    assert (await client.get("/healthz")).json() == {"status": "ok"}
    ready = await client.get("/readyz")
    assert (ready.status_code, ready.json()) == (
        200,
        {"status": "ready", "checks": {"database": "ok", "objects": "ok"}},
    )


async def test_a_database_that_is_away_is_named_and_requests_fail_fast(services: Services):
    away = Database("postgresql+psycopg://nobody@127.0.0.1:1/none")
    async with _caller(replace(services, database=away)) as client:
        unready = await client.get("/readyz")
        assert unready.status_code == 503
        assert "retry-after" in unready.headers
        assert unready.json()["checks"]["objects"] == "ok"
        assert "the database must answer" in unready.json()["checks"]["database"]
        answer = await client.get("/v1/people")
        assert answer.status_code == 503
        assert answer.headers["retry-after"]
        assert answer.headers["content-type"] == "application/problem+json"
        assert (await client.get("/metrics")).status_code == 200


async def test_an_object_store_that_is_away_is_named(services: Services):
    broken = replace(services, objects=AwayObjects(MemoryStore()))
    async with _caller(broken) as client:
        unready = await client.get("/readyz")
        assert (unready.status_code, unready.json()["status"]) == (503, "unready")
        assert unready.json()["checks"]["database"] == "ok"
        assert "connection refused" in unready.json()["checks"]["objects"]
        assert (await client.get("/healthz")).status_code == 200
        assert 'metanerf_store_up{store="objects"} 0.0' in (await client.get("/metrics")).text
        # what does not need it goes on
        assert (await client.post("/v1/people", json={"name": "Ada"})).status_code == 201


async def test_without_redis_a_gateway_is_degraded_and_serves(services: Services):
    url = "redis://127.0.0.1:1/0"
    settings = changed(services.settings, redis_url=url)
    async with _caller(replace(services, events=RedisEvents(url), settings=settings)) as client:
        degraded = await client.get("/readyz")
        assert (degraded.status_code, degraded.json()["status"]) == (200, "degraded")
        assert "retry-after" not in degraded.headers
        checks = degraded.json()["checks"]
        assert "refused" in checks.pop("redis")
        assert checks == {"database": "ok", "objects": "ok"}
        assert (await client.post("/v1/people", json={"name": "Ada"})).status_code == 201


async def test_a_store_that_hangs_is_named_while_the_probe_waits(
    services: Services, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(readiness, "PATIENCE_S", 0.1)
    answered = threading.Event()

    class Hanging(AwayObjects):
        def ping(self) -> None:
            answered.wait(30.0)

    async with _caller(replace(services, objects=Hanging(MemoryStore()))) as client:
        checks = (await client.get("/readyz")).json()["checks"]
    answered.set()
    assert checks == {"database": "ok", "objects": "no answer in 0.1 s"}


async def test_requests_are_counted_by_route(client: httpx.AsyncClient):
    await client.get("/v1/people/somebody")
    text = (await client.get("/metrics")).text
    counted = 'metanerf_requests_total{method="GET",route="/v1/people/{person_id}",status="404"}'
    assert counted in text
    assert 'metanerf_jobs{kind="train",state="queued"} 0.0' in text


async def test_every_route_is_described(client: httpx.AsyncClient):
    described = (await client.get("/openapi.json")).json()
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            assert operation.get("summary"), (method, path)
            assert operation.get("tags"), (method, path)
            assert operation.get("description"), (method, path)
    assert "Problem" in described["components"]["schemas"]
    assert (await client.get("/docs")).status_code == 200


async def test_a_page_that_is_not_built_says_how_to_build_it(client: httpx.AsyncClient):
    answer = await client.get("/")
    assert answer.status_code == 200
    assert "make demo" in answer.text


async def test_the_built_page_is_served(services: Services, tmp_path: Path):
    page = tmp_path / "dist"
    page.mkdir()
    (page / "index.html").write_text("<title>the page</title>")
    settings = changed(services.settings, client_dir=page)
    async with _caller(replace(services, settings=settings)) as client:
        assert "the page" in (await client.get("/")).text
        assert (await client.get("/?meeting=1")).status_code == 200
        assert (await client.get("/healthz")).json() == {"status": "ok"}
        missing = await client.get("/nothing.js")
        assert missing.status_code == 404


async def test_surprises_tell_no_secrets(services: Services, tmp_path: Path):
    class Broken(Database):
        def reading(self):
            raise RuntimeError("the password is 1234")

    async with _caller(replace(services, database=Broken(f"sqlite:///{tmp_path}/a.db"))) as client:
        answer = await client.get("/v1/people")
    assert answer.status_code == 500
    assert "1234" not in answer.text
    assert "RuntimeError" in answer.json()["detail"]
