"""A clip is deleted with its frames and motion; models stay, and what is at work holds it."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from db.models import JobKind, JobState, SequenceRow
from services.app import create_app
from services.container import Services
from services.gateway import gateway_of
from tests.services import seeds
from tests.services.conftest import bearer, stored_files


@pytest.fixture
def sequence(services: Services, sequence_folder: Path) -> SequenceRow:
    return seeds.captured(services, sequence_folder)


def training(services: Services, sequence: SequenceRow, state: JobState) -> str:
    """A training of `sequence` that has come as far as `state`, with its checkpoint and picture."""
    job_id = seeds.queued_training(services, sequence)
    checkpoint = services.objects.put(sequence.person_id, [b"weights"])
    with services.unit_of_work() as unit:
        job = unit.jobs.get(job_id)
        job.state, job.checkpoint_sha256 = state, checkpoint.sha256
        job.preview, job.preview_version = b"picture", 1
        unit.commit()
    return job_id


async def test_a_deleted_clip_leaves_its_model_and_nothing_else(
    client: httpx.AsyncClient, services: Services, sequence: SequenceRow
):
    job_id = training(services, sequence, JobState.CANCELLED)
    kept = seeds.trained(services, sequence)
    assert len(stored_files(services.settings)) == 5
    deleted = await client.delete(f"/v1/sequences/{sequence.id}")
    assert (deleted.status_code, deleted.content) == (204, b"")
    assert [path.name for path in stored_files(services.settings)] == [kept.files[0].sha256]
    assert (await client.get(f"/v1/sequences/{sequence.id}")).status_code == 404
    assert (await client.delete(f"/v1/sequences/{sequence.id}")).status_code == 404
    model = await client.get(f"/v1/models/{kept.id}")
    assert (model.status_code, model.json()["sequence_id"]) == (200, None)
    assert (await client.get(f"/v1/jobs/{job_id}/preview")).status_code == 404
    assert (await client.post(f"/v1/jobs/{job_id}/resume")).status_code == 409
    with services.reading() as unit:
        assert unit.motions.of_sequence(sequence.id) is None
        assert [event.action for event in unit.audit.of_account("house")] == ["sequence.deleted"]


@pytest.mark.parametrize("state", [JobState.QUEUED, JobState.RUNNING])
async def test_what_is_at_work_holds_its_clip(
    client: httpx.AsyncClient, services: Services, sequence: SequenceRow, state: JobState
):
    job_id = training(services, sequence, state)
    seeds.queued_training(services, sequence)
    with services.unit_of_work() as unit:
        newest = unit.jobs.latest(sequence.id, JobKind.TRAIN)
        assert newest is not None
        newest.state = JobState.SUCCEEDED
        unit.commit()
    before = stored_files(services.settings)
    refused = await client.delete(f"/v1/sequences/{sequence.id}")
    assert refused.status_code == 409
    assert refused.headers["content-type"] == "application/problem+json"
    assert refused.json()["type"] == "urn:metanerf:sequence-in-use"
    assert f"got the train job {job_id}, which is {state}" in refused.json()["detail"]
    assert stored_files(services.settings) == before
    assert (await client.get(f"/v1/sequences/{sequence.id}")).status_code == 200


async def test_somebody_elses_clip_stays(
    client: httpx.AsyncClient, services: Services, sequence: SequenceRow
):
    stranger = bearer(services, "elsewhere")
    refused = await client.delete(f"/v1/sequences/{sequence.id}", headers=stranger)
    assert refused.status_code == 403
    assert (await client.get(f"/v1/sequences/{sequence.id}")).status_code == 200


async def test_who_moved_by_it_moves_as_they_were_filmed(
    client: httpx.AsyncClient,
    services: Services,
    sequence: SequenceRow,
    model_file: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    app = create_app(services)
    told: list[str] = []

    async def listener(meeting_id: str) -> None:
        told.append(meeting_id)

    monkeypatch.setattr(gateway_of(app).views, "refresh", listener)
    model = seeds.imported(services, model_file, "house", "Bo")
    meeting = (await client.post("/v1/meetings", json={"name": "Monday"})).json()
    place = f"/v1/meetings/{meeting['id']}"
    moved = {"model_id": model.id, "motion_sequence_id": sequence.id}
    assert (await client.post(f"{place}/performers", json=moved)).status_code == 201
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(
        transport=transport, base_url="http://test", headers=bearer(services)
    ) as caller:
        deleted = await caller.delete(f"/v1/sequences/{sequence.id}")
    assert deleted.status_code == 204
    assert told == [meeting["id"]]
    (performer,) = (await client.get(place)).json()["performers"]
    assert performer["motion_sequence_id"] is None
