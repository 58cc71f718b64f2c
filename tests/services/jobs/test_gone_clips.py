"""A job whose clip or frames are gone ends and says so; younger jobs have their turn."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import SecretStr

from db.models import JobKind, JobRow, JobState, SequenceRow, SequenceState
from services.composition import build_services
from services.container import Services
from services.errors import ClipGone
from services.jobs.queue import enqueue, fail, finish, resume
from services.problems import stored_failure
from services.settings import Settings
from tests.servers import DATABASES, fresh_database
from tests.services import seeds
from tests.services.conftest import changed, serving
from tests.services.jobs.waiting import job_when


@pytest.fixture(params=DATABASES)
def working(
    request: pytest.FixtureRequest, settings: Settings, tmp_path: Path
) -> Iterator[Settings]:
    """A gateway that runs jobs: on SQLite and a folder, or on PostgreSQL, Redis and S3."""
    with fresh_database(request.param, tmp_path) as url:
        changes = {"database_url": url, "embedded_worker": True}
        if request.param == "postgresql":
            changes |= {
                "redis_url": request.getfixturevalue("redis_url"),
                "object_store_url": f"s3://test/{uuid.uuid4().hex}",
                "s3_endpoint_url": request.getfixturevalue("s3_endpoint"),
                "s3_access_key_id": "a",
                "s3_secret_access_key": SecretStr("b"),
            }
        yield changed(settings, **changes)


def _queue(services: Services, sequence: SequenceRow, kind: JobKind) -> str:
    with services.unit_of_work() as unit:
        params = {"preset": "splats", "budget_s": 1.0, "seed": 0}
        job = enqueue(unit, kind, sequence, params, services.clock())
        unit.commit()
    return job.id


def test_jobs_without_their_clips_fail_and_a_younger_job_is_done(
    working: Settings, sequence_folder: Path
):
    services = build_services(working)
    services.database.migrate()
    forgotten, lost, whole = (seeds.captured(services, sequence_folder) for _ in range(3))
    never_stored = seeds.uploaded(services)
    hopeless = [
        _queue(services, forgotten, JobKind.TRAIN),
        _queue(services, lost, JobKind.TRAIN),
        _queue(services, never_stored, JobKind.CAPTURE),
    ]
    younger = _queue(services, whole, JobKind.TRAIN)
    assert lost.packed_sha256 is not None
    services.objects.delete(lost.person_id, lost.packed_sha256)
    with services.unit_of_work() as unit:
        row = unit.sequences.get(forgotten.id)
        row.state, row.packed_sha256 = SequenceState.FORGOTTEN, None
        unit.commit()
    services.close()
    with serving(working) as caller:
        for job_id in hopeless:
            job = job_when(caller, job_id, lambda job: job["state"] == "failed", "its end")
            assert job["error"]["type"] == "urn:metanerf:clip-gone"
            assert "cannot come back; upload the clip again" in job["message"]
        done = job_when(caller, younger, lambda job: job["state"] == "succeeded", "the training")
        assert done["model_id"] is not None
        again = caller.post(f"/v1/jobs/{hopeless[0]}/resume")
        assert (again.status_code, again.json()["type"]) == (410, "urn:metanerf:clip-gone")


@pytest.mark.parametrize("end", [JobState.FAILED, JobState.CANCELLED])
def test_a_clip_for_one_model_waits_for_every_training_and_goes_with_the_last(
    services: Services, sequence_folder: Path, end: JobState
):
    sequence = seeds.captured(services, sequence_folder)
    jobs = [_queue(services, sequence, JobKind.TRAIN) for _ in range(3)]

    def ended(job_id: str, state: JobState) -> tuple[SequenceState, JobRow]:
        with services.unit_of_work() as unit:
            job = unit.jobs.get(job_id)
            if state is JobState.FAILED:
                fail(unit, job, RuntimeError("it broke"), services.clock(), stored_failure)
            else:
                finish(unit, job, state, services.clock())
            unit.commit()
            return unit.sequences.get(sequence.id).state, job

    with services.unit_of_work() as unit:
        unit.sequences.get(sequence.id).model_only = True
        unit.commit()
    # the youngest ends first, as where several workers train
    assert ended(jobs[2], JobState.SUCCEEDED)[0] is SequenceState.READY
    assert ended(jobs[0], end)[0] is SequenceState.READY
    state, last = ended(jobs[1], end)
    assert state is SequenceState.FORGOTTEN
    with services.unit_of_work() as unit, pytest.raises(ClipGone, match="cannot come back"):
        resume(unit, last)


def test_a_clip_of_which_no_model_was_made_stays(services: Services, sequence_folder: Path):
    sequence = seeds.captured(services, sequence_folder)
    job_id = _queue(services, sequence, JobKind.TRAIN)
    with services.unit_of_work() as unit:
        unit.sequences.get(sequence.id).model_only = True
        finish(unit, unit.jobs.get(job_id), JobState.CANCELLED, services.clock())
        unit.commit()
    with services.reading() as unit:
        assert unit.sequences.get(sequence.id).state is SequenceState.READY
