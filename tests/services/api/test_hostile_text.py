"""Text and numbers that databases can't hold are refused, on both of them, and never fail."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import httpx
import pytest
from pydantic import ValidationError

from services.composition import build_services
from services.container import Services
from services.control.messages import TO_SERVER
from services.settings import load_settings
from tests.servers import DATABASES, fresh_database, make_schema
from tests.services.conftest import SECRET, calling


@pytest.fixture(params=DATABASES, scope="module")
def services(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, empty_database: Path
) -> Iterator[Services]:
    """For all tests of one kind: what one leaves is nothing to the next."""
    folder = tmp_path_factory.mktemp("hostile")
    with fresh_database(request.param, folder) as url:
        made = build_services(
            load_settings(
                data_dir=folder / "data",
                database_url=url,
                jwt_secret=SECRET,
                open_access=True,
                embedded_worker=False,
            )
        )
        make_schema(made.database, empty_database)
        yield made
        made.close()


@pytest.fixture
async def caller(services: Services) -> AsyncIterator[httpx.AsyncClient]:
    async with calling(services) as made:
        yield made


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
