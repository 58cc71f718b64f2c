"""Every answer has a policy; the page's names the gateways and its workers' lets them compile."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from services.app import create_app
from services.container import Services
from services.content_policy import CSP, page_policy
from services.gateway import gateway_of
from tests.services.conftest import changed


def directives(answer: httpx.Response) -> dict[str, list[str]]:
    parts = (one.split() for one in answer.headers[CSP].split(";"))
    return {name: sources for name, *sources in parts}


@pytest.fixture
def page(tmp_path: Path) -> Path:
    made = tmp_path / "dist"
    (made / "assets").mkdir(parents=True)
    (made / "index.html").write_text("<title>the page</title>")
    (made / "assets" / "worker-1.js").write_text("0")
    (made / "assets" / "index-1.css").write_text("b{}")
    return made


@pytest.fixture
async def caller(services: Services, page: Path) -> AsyncIterator[httpx.AsyncClient]:
    url = "https://one.example"
    settings = changed(services.settings, client_dir=page, gateway_url=url)
    app = create_app(replace(services, settings=settings))
    gateway_of(app).homes.renew()
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://test") as made:
        yield made


@pytest.mark.parametrize(
    "path", ["/", "/healthz", "/docs", "/v1/people", "/nothing", "/assets/worker-1.js"]
)
async def test_every_answer_is_closed_by_default(caller: httpx.AsyncClient, path: str):
    answer = await caller.get(path)
    policy = directives(answer)
    for name in ("default-src", "base-uri", "form-action", "frame-ancestors"):
        assert policy[name] == ["'none'"], name
    for loose in ("'unsafe-inline'", "'unsafe-eval'", " *", "http:", "https:;"):
        assert loose not in answer.headers[CSP]
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert answer.headers["Referrer-Policy"] == "no-referrer"
    assert "camera=(self)" in answer.headers["Permissions-Policy"]


async def test_an_answer_of_the_api_may_do_nothing(caller: httpx.AsyncClient):
    assert set(directives(await caller.get("/healthz"))) == {
        "default-src",
        "base-uri",
        "form-action",
        "frame-ancestors",
    }


async def test_a_surprise_is_closed_too(caller: httpx.AsyncClient, monkeypatch):
    monkeypatch.setattr("services.api.operation.Health", lambda: 1 / 0)
    answer = await caller.get("/healthz")
    assert answer.status_code == 500
    assert CSP in answer.headers


async def test_the_page_talks_to_the_gateways_alone(caller: httpx.AsyncClient):
    answer = await caller.get("/?meeting=1")
    policy = directives(answer)
    assert policy["connect-src"] == ["'self'", "https://one.example", "wss://one.example"]
    assert policy["script-src"] == ["'self'"]
    assert answer.headers["Cache-Control"] == "no-cache"
    assert "ws://two.example:81" in page_policy(["http://two.example:81"])


async def test_scripts_of_workers_compile_and_talk_home(caller: httpx.AsyncClient):
    policy = directives(await caller.get("/assets/worker-1.js"))
    assert policy["script-src"] == ["'self'", "'wasm-unsafe-eval'"]
    assert policy["connect-src"] == ["'self'"]


@pytest.mark.parametrize("path", ["/", "/assets/worker-1.js"])
async def test_what_a_browser_has_already_keeps_its_policy(caller: httpx.AsyncClient, path: str):
    first = await caller.get(path)
    again = await caller.get(path, headers={"If-None-Match": first.headers["ETag"]})
    assert again.status_code == 304
    assert again.headers[CSP] == first.headers[CSP]


async def test_the_description_of_the_api_needs_no_script(caller: httpx.AsyncClient):
    answer = await caller.get("/docs")
    text = answer.text
    assert "<script" not in text
    for path in (await caller.get("/openapi.json")).json()["paths"]:
        assert re.search(rf"<code>(GET|POST|PUT|PATCH|DELETE) {re.escape(path)}</code>", text), path
    assert directives(answer)["style-src"][0].startswith("'sha256-")
