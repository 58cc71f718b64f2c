"""What one account may keep, and how often it may ask, told with what is used."""

from __future__ import annotations

import hashlib
import json
from collections.abc import AsyncIterator, Callable
from datetime import timedelta
from typing import Any

import httpx
import pytest

from db.models import JobKind
from services.app import create_app
from services.composition import build_services
from services.container import Services
from services.settings import Settings
from tests.fakes import Clock
from tests.services import seeds
from tests.services.conftest import bearer, changed, stored_files

Limited = Callable[..., httpx.AsyncClient]


@pytest.fixture
def limited(services: Services) -> Limited:
    """Callers of account `house` at a gateway with such limits."""

    def make(**limits: int) -> httpx.AsyncClient:
        settings = changed(services.settings, **limits)
        made = build_services(settings)
        transport = httpx.ASGITransport(create_app(made), raise_app_exceptions=False)
        return httpx.AsyncClient(
            transport=transport, base_url="http://test", headers=bearer(services)
        )

    return make


async def added(caller: httpx.AsyncClient, **options: Any) -> str:
    answer = await caller.post("/v1/people", json={"name": "Ada"}, **options)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


def refused(answer: httpx.Response) -> str:
    """What a quota says."""
    assert answer.status_code == 403, answer.text
    problem = answer.json()
    assert problem["type"] == "urn:metanerf:quota-reached"
    return problem["detail"]


def keypoints(frames: int) -> dict[str, Any]:
    return {"file": ("motion.json", json.dumps(seeds.keypoints(frames)).encode())}


async def test_people_of_one_account_are_so_many(limited: Limited, services: Services):
    async with limited(account_people=2) as caller:
        first, _ = await added(caller), await added(caller)
        told = refused(await caller.post("/v1/people", json={"name": "Bo"}))
        assert "at most 2 people; got 2 and 1 more; erase one" in told
        await added(caller, headers=bearer(services, "another"))
        assert (await caller.delete(f"/v1/people/{first}")).status_code == 200
        await added(caller)


async def test_clips_of_one_account_are_so_many_and_the_same_again_is_free(limited: Limited):
    async with limited(account_sequences=1) as caller:
        one, other = await added(caller), await added(caller)
        path = f"/v1/people/{one}/sequences"
        sequence = (await caller.post(path, files=keypoints(3))).json()
        assert (await caller.post(path, files=keypoints(3))).json()["id"] == sequence["id"]
        for person in (one, other):
            told = refused(await caller.post(f"/v1/people/{person}/sequences", files=keypoints(4)))
            assert "at most 1 clips; got 1 and 1 more; delete one" in told
        body = {"filename": "b.mp4", "size": 3, "sha256": "3" * 64}
        refused(await caller.post(f"/v1/people/{one}/uploads", json=body))
        assert (await caller.delete(f"/v1/sequences/{sequence['id']}")).status_code == 204
        assert (await caller.post(path, files=keypoints(4))).status_code == 202


async def test_bytes_of_one_account_are_so_many(limited: Limited, settings: Settings):
    (_, data), *_ = keypoints(3).values()
    async with limited(account_bytes=2 * len(data)) as caller:
        person = await added(caller)
        path = f"/v1/people/{person}/sequences"
        assert (await caller.post(path, files=keypoints(3))).status_code == 202
        before = stored_files(settings)
        told = refused(await caller.post(path, files=keypoints(9)))
        assert "GiB more; delete clips" in told

        sample = httpx.Request("POST", "http://test", files=keypoints(9))
        kind = {"content-type": sample.headers["content-type"]}

        async def body() -> AsyncIterator[bytes]:
            yield sample.read()

        refused(await caller.post(path, content=body(), headers=kind))
        assert stored_files(settings) == before


async def test_what_an_upload_has_still_to_send_counts(limited: Limited):
    data = keypoints(3)["file"][1]
    begun = {"filename": "a.json", "size": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    async with limited(account_bytes=len(data) + 9) as caller:
        person = await added(caller)
        uploads = f"/v1/people/{person}/uploads"
        upload = (await caller.post(uploads, json=begun)).json()["id"]
        refused(await caller.post(uploads, json=begun | {"sha256": "3" * 64}))
        # one that was begun is gone on with, and is taken once it is whole
        assert (await caller.post(uploads, json=begun)).json()["id"] == upload
        answer = await caller.patch(
            f"/v1/uploads/{upload}", content=data, headers={"upload-offset": "0"}
        )
        assert answer.status_code == 202


async def test_models_and_trainings_under_way_are_so_many(
    limited: Limited, services: Services, sequence_folder: Any
):
    sequence = seeds.captured(services, sequence_folder)
    seeds.trained(services, sequence)
    async with limited(account_models=2) as caller:
        path = f"/v1/sequences/{sequence.id}/models"
        assert (await caller.post(path, json={})).status_code == 202
        told = refused(await caller.post(path, json={}))
        assert "at most 2 models; got 2 and 1 more; erase a person, or cancel" in told
        with services.unit_of_work() as unit:
            job = unit.jobs.latest(sequence.id, JobKind.TRAIN)
        assert job is not None
        await caller.delete(f"/v1/jobs/{job.id}")
        assert (await caller.post(path, json={})).status_code == 202


async def test_an_account_asks_so_often_and_an_address_too(settings: Settings):
    clock = Clock()
    services = build_services(
        changed(settings, requests_per_minute=3, requests_per_address=8), clock=clock
    )
    services.database.migrate()
    app = create_app(services)

    async def ask(account: str | None, address: str = "192.0.2.1") -> int:
        transport = httpx.ASGITransport(app, client=(address, 1), raise_app_exceptions=False)
        headers = {"Authorization": "Bearer guessed"}
        if account is not None:
            token, _ = services.tokens.issue(account, frozenset({"read"}), timedelta(days=9999))
            headers = {"Authorization": f"Bearer {token}"}
        async with httpx.AsyncClient(transport=transport, base_url="http://test") as caller:
            answer = await caller.get("/v1/people", headers=headers)
        if answer.status_code == 429:
            assert int(answer.headers["retry-after"]) > 0
            assert answer.json()["type"] == "urn:metanerf:too-many-requests"
        return answer.status_code

    assert [await ask("a") for _ in range(4)] == [200, 200, 200, 429]
    assert await ask("a", "192.0.2.2") == 429
    assert await ask("b") == 200
    # who has no good token uses up their address, and nobody else's account
    assert [await ask(None) for _ in range(4)] == [401, 401, 401, 429]
    assert await ask("b") == 429
    assert await ask("b", "192.0.2.2") == 200
    clock.advance(seconds=60)
    assert await ask("a") == 200
    services.close()
