"""Pages get the very model file that capture uses, or are told why not."""

from __future__ import annotations

from dataclasses import replace

import httpx
import pytest

from capture.live.solver_constants import solver_constants
from services.app import create_app
from services.container import Services
from tests.services.conftest import changed


async def asked(services: Services, name: str = "model") -> httpx.Response:
    transport = httpx.ASGITransport(create_app(services))
    async with httpx.AsyncClient(transport=transport, base_url="http://test") as page:
        return await page.get(f"/v1/landmarks/{name}")


async def test_the_checked_file_is_handed_out_and_kept(services: Services, tmp_path):
    file = tmp_path / "pose.task"
    file.write_bytes(b"a model" * 1000)
    settings = changed(services.settings, pose_model=file)
    answer = await asked(replace(services, settings=settings))
    assert answer.status_code == 200
    assert answer.content == file.read_bytes()
    assert "max-age" in answer.headers["cache-control"]
    assert answer.headers["etag"]


@pytest.mark.parametrize("name", ["face", "hand"])
async def test_face_and_hands_have_models_of_their_own(services: Services, tmp_path, name):
    file = tmp_path / f"{name}.task"
    file.write_bytes(name.encode())
    settings = changed(services.settings, **{f"{name}_model": file})
    answer = await asked(replace(services, settings=settings), f"{name}-model")
    assert (answer.status_code, answer.content) == (200, name.encode())
    absent = changed(services.settings, **{f"{name}_model": tmp_path / "absent.task"})
    refused = await asked(replace(services, settings=absent), f"{name}-model")
    assert refused.status_code == 503
    assert refused.json()["type"].endswith("landmark-model-missing")


async def test_a_file_that_is_not_there_is_told_without_its_place(services: Services, tmp_path):
    settings = changed(services.settings, pose_model=tmp_path / "pose.task")
    answer = await asked(replace(services, settings=settings))
    assert answer.status_code == 503
    assert int(answer.headers["retry-after"]) > 0
    assert "landmark model must be on this server; got none" in answer.json()["detail"]
    assert str(tmp_path) not in answer.text


async def test_a_page_gets_what_it_solves_poses_with(services: Services):
    answer = await asked(services, "solver")
    assert answer.status_code == 200
    assert answer.content == solver_constants()
    assert "max-age" in answer.headers["cache-control"]
