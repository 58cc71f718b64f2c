"""The file that a viewer's page draws: who gets it, once, and who does not."""

from __future__ import annotations

import gzip
import hashlib
from pathlib import Path

import httpx
import pytest

from db.models import ModelRow
from services.api.gzipped import takes_gzip
from services.container import Services
from tests.services import seeds
from tests.services.conftest import bearer


@pytest.fixture
def model(services: Services, model_file: Path) -> ModelRow:
    return seeds.imported(services, model_file, "house", "Ada")


def url(model: ModelRow) -> str:
    return f"/v1/models/{model.id}/files/viewer.splats"


async def join(client: httpx.AsyncClient, *models: ModelRow) -> dict[str, str]:
    """The header of a viewer from elsewhere who sits in a meeting with `models`."""
    asked = {"name": "Monday", "model_ids": [model.id for model in models]}
    meeting = (await client.post("/v1/meetings", json=asked)).json()
    seat = await client.post(f"/v1/meetings/{meeting['id']}/join", json={"display_name": "Bo"})
    return {"Authorization": f"Bearer {seat.json()['token']}"}


async def test_whoever_sits_in_the_meeting_gets_it_once(client: httpx.AsyncClient, model: ModelRow):
    seat = await join(client, model) | {"Accept-Encoding": "identity"}
    first = await client.get(url(model), headers=seat)
    assert first.status_code == 200
    assert first.headers["etag"] == f'"{hashlib.sha256(first.content).hexdigest()}"'
    assert first.headers["cache-control"] == "private, no-cache"
    assert int(first.headers["content-length"]) == len(first.content) < 5_000_000
    again = await client.get(url(model), headers=seat | {"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["etag"] == first.headers["etag"]


async def test_of_a_model_that_is_not_made_of_splats_there_is_none(
    client: httpx.AsyncClient, services: Services, model: ModelRow
):
    with services.unit_of_work() as unit:
        stored = unit.models.get(model.id)
        stored.files = [file for file in stored.files if file.name == "model.safetensors"]
        unit.commit()
    answer = await client.get(url(model), headers=await join(client, model))
    assert (answer.status_code, answer.content) == (204, b"")


async def test_it_is_compressed_for_who_takes_that(client: httpx.AsyncClient, model: ModelRow):
    seat = await join(client, model)
    plain = await client.get(url(model), headers=seat | {"Accept-Encoding": "gzip;q=0"})
    asking = seat | {"Accept-Encoding": "br, gzip"}
    async with client.stream("GET", url(model), headers=asking) as sent:
        packed = b"".join([piece async for piece in sent.aiter_raw()])
    assert gzip.decompress(packed) == plain.content
    assert len(packed) < 0.8 * len(plain.content)
    assert sent.headers["content-encoding"] == "gzip"
    assert "content-encoding" not in plain.headers
    assert {sent.headers["vary"], plain.headers["vary"]} == {"Accept-Encoding"}
    assert sent.headers["etag"] != plain.headers["etag"]
    again = await client.get(url(model), headers=asking | {"If-None-Match": sent.headers["etag"]})
    assert (again.status_code, again.headers["etag"]) == (304, sent.headers["etag"])


@pytest.mark.parametrize(
    ("header", "takes"),
    [
        ("", False),
        ("identity", False),
        ("gzip;q=0", False),
        ("br;q=1.0, GZIP;q=0.5", True),
        ("*", True),
    ],
)
def test_who_takes_gzip(header: str, takes: bool):
    assert takes_gzip(header) is takes


async def test_a_seat_opens_no_other_file_and_no_other_model(
    client: httpx.AsyncClient, services: Services, model: ModelRow, model_file: Path
):
    other = seeds.imported(services, model_file, "house", "Bo")
    seat = await join(client, model)
    absent = await client.get(url(other), headers=seat)
    assert absent.status_code == 403
    assert "must stand in the meeting" in absent.json()["detail"]
    for name in ("model.safetensors", "splats.ply"):
        refused = await client.get(f"/v1/models/{model.id}/files/{name}", headers=seat)
        assert refused.status_code == 403


async def test_who_was_sent_out_of_the_cast_is_handed_out_no_longer(
    client: httpx.AsyncClient, model: ModelRow
):
    asked = {"name": "Monday", "model_ids": [model.id]}
    meeting = (await client.post("/v1/meetings", json=asked)).json()
    seated = await client.post(f"/v1/meetings/{meeting['id']}/join", json={"display_name": "Bo"})
    seat = {"Authorization": f"Bearer {seated.json()['token']}"}
    assert (await client.get(url(model), headers=seat)).status_code == 200
    (performer,) = meeting["performers"]
    path = f"/v1/meetings/{meeting['id']}/performers/{performer['id']}"
    assert (await client.delete(path)).status_code == 204
    assert (await client.get(url(model), headers=seat)).status_code == 403


async def test_strangers_and_other_accounts_get_nothing(
    client: httpx.AsyncClient, services: Services, model: ModelRow
):
    neighbour = await client.get(url(model), headers=bearer(services, account="neighbours"))
    assert neighbour.status_code == 403
    client.headers.pop("Authorization")
    nobody = await client.get(url(model))
    assert nobody.status_code == 401
    assert nobody.headers["content-type"] == "application/problem+json"
