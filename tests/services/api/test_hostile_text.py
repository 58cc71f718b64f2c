"""Text and numbers that databases can't hold are refused, on both of them, and never fail."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest
from pydantic import ValidationError

from services.app import create_app
from services.composition import build_services
from services.control.messages import TO_SERVER
from services.settings import Settings
from tests.servers import DATABASES, fresh_database
from tests.services.conftest import bearer, changed


@pytest.fixture(params=DATABASES)
async def caller(
    request: pytest.FixtureRequest, settings: Settings, tmp_path: Path
) -> AsyncIterator[httpx.AsyncClient]:
    with fresh_database(request.param, tmp_path) as url:
        services = build_services(changed(settings, database_url=url))
        services.database.migrate()
        transport = httpx.ASGITransport(create_app(services), raise_app_exceptions=False)
        async with httpx.AsyncClient(
            transport=transport, base_url="http://test", headers=bearer(services)
        ) as made:
            yield made
        services.close()


@pytest.mark.parametrize("text", ["a\\u0000b", "\\u0000", "\\ud800", "\\u202e", "x" * 10_000])
async def test_hostile_names_fail_nothing(caller: httpx.AsyncClient, text: str):
    header = {"content-type": "application/json"}
    for path, body in (
        ("/v1/people", f'{{"name": "{text}"}}'),
        ("/v1/meetings", f'{{"name": "{text}"}}'),
        ("/v1/meetings", f'{{"name": "x", "model_ids": ["{text}"]}}'),
    ):
        answer = await caller.post(path, content=body, headers=header)
        assert answer.status_code < 500, (path, answer.text)


@pytest.mark.parametrize("text", ["%00", "a%00b", "%ff", "%27;--", "9" * 10_000])
async def test_hostile_ids_fail_nothing(caller: httpx.AsyncClient, text: str):
    for method, path in (
        *(
            ("GET", f"/v1/{what}/{text}")
            for what in ("people", "models", "sequences", "jobs", "meetings", "recordings")
        ),
        ("HEAD", f"/v1/uploads/{text}"),
        ("DELETE", f"/v1/jobs/{text}"),
        ("GET", f"/v1/recordings/{text}/tracks/{text}"),
    ):
        answer = await caller.request(method, path)
        assert answer.status_code in (404, 422), (method, path[:60], answer.text)


def test_a_message_number_beyond_the_database_is_refused():
    hello = {"type": "hello", "token": "t", "name": "Ada", "after": 10**30}
    with pytest.raises(ValidationError, match="less than or equal"):
        TO_SERVER.validate_python(hello)
