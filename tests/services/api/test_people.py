"""People are added, read and erased; what is wrong is a problem with its rule."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest

from services.container import Services
from tests.services import seeds
from tests.services.conftest import stored_files


async def test_a_person_is_added_and_read(client: httpx.AsyncClient):
    added = await client.post("/v1/people", json={"name": "  Ada "})
    assert added.status_code == 201
    assert added.json()["name"] == "Ada"
    person = (await client.get(f"/v1/people/{added.json()['id']}")).json()
    assert person == added.json() | {"sequences": [], "models": []}
    assert (await client.get("/v1/people")).json()["items"] == [added.json() | {"mine": True}]


async def test_a_height_is_kept_and_told_where_it_was_given(client: httpx.AsyncClient):
    tall = (await client.post("/v1/people", json={"name": "Ada", "height_m": 1.785})).json()
    assert tall["height_m"] == 1.785
    assert (await client.get(f"/v1/people/{tall['id']}")).json()["height_m"] == 1.785
    await client.post("/v1/people", json={"name": "Bo"})
    people = (await client.get("/v1/people")).json()["items"]
    assert {one["name"]: one["height_m"] for one in people} == {"Ada": 1.785, "Bo": None}


async def test_a_body_that_is_no_json_is_told_where(client: httpx.AsyncClient):
    headers = {"Content-Type": "application/json"}
    answer = await client.post("/v1/people", content=b"{oops", headers=headers)
    assert answer.status_code == 422
    assert "the body must be JSON; got a fault at character 1" in answer.json()["detail"]


@pytest.mark.parametrize("kind", ["application/json", "multipart/form-data; boundary=x", ""])
async def test_a_body_that_would_fill_the_memory_is_cut_off(client: httpx.AsyncClient, kind: str):
    sent = 0

    async def endless() -> AsyncIterator[bytes]:
        nonlocal sent
        while sent < 100_000_000:
            sent += 100_000
            yield b"1" * 100_000

    answer = await client.post("/v1/people", content=endless(), headers={"Content-Type": kind})
    assert answer.status_code == 413
    assert answer.json()["type"] == "urn:metanerf:too-large"
    assert "at most 1048576 bytes" in answer.json()["detail"]
    assert sent < 3_000_000


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ({"name": ""}, "body.name"),
        ({"name": "x" * 121}, "at most 120"),
        ({}, "Field required"),
        ({"name": "Ada", "nmae": 1}, "body.nmae"),
        ({"name": "Ada", "height_m": 178}, "body.height_m: Input should be less than or equal"),
        ({"name": "Ada", "height_m": 0.4}, "body.height_m: Input should be greater than or equal"),
        ({"name": "Ada", "height_m": "tall"}, "body.height_m"),
    ],
)
async def test_bad_bodies_are_told_by_field_and_value(
    client: httpx.AsyncClient, body: dict, told: str
):
    answer = await client.post("/v1/people", json=body)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert set(answer.json()) == {"type", "title", "status", "detail"}
    assert told in answer.json()["detail"]
    assert "got" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/v1/people/nobody"),
        ("DELETE", "/v1/people/nobody"),
        ("GET", "/v1/sequences/none"),
        ("GET", "/v1/sequences/none/thumbnail"),
        ("GET", "/v1/jobs/none"),
        ("DELETE", "/v1/jobs/none"),
        ("GET", "/v1/jobs/none/events"),
        ("GET", "/v1/jobs/none/preview"),
        ("GET", "/v1/models/none"),
        ("GET", "/v1/models/none/files/model.safetensors"),
        ("GET", "/v1/meetings/none"),
        ("HEAD", "/v1/uploads/none"),
        ("GET", "/v1/nothing-of-the-kind"),
    ],
)
async def test_unknown_ids_are_not_found(client: httpx.AsyncClient, method: str, path: str):
    answer = await client.request(method, path)
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"


async def test_erasing_a_person_proves_it(
    client: httpx.AsyncClient, services: Services, sequence_folder: Path
):
    sequence = seeds.captured(services, sequence_folder)
    seeds.queued_training(services, sequence)
    assert len(stored_files(services.settings)) == 3
    erased = await client.delete(f"/v1/people/{sequence.person_id}")
    assert erased.status_code == 200
    assert erased.json() == {
        "deleted_rows": {"person": 1, "sequence": 1, "motion": 1, "job": 1},
        "deleted_objects": 3,
        "remaining": 0,
    }
    assert stored_files(services.settings) == []
    assert (await client.get(f"/v1/people/{sequence.person_id}")).status_code == 404
    assert (await client.get(f"/v1/sequences/{sequence.id}")).status_code == 404
