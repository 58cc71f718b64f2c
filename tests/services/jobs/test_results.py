"""What a job made is stored whole, or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from db.models import JobRow, JobState
from services.container import Services
from services.jobs.report import JobStopped
from services.jobs.results import Results
from tests.services import seeds


def keep_what_was_made(services: Services, job: JobRow) -> None:
    with Results(services, job) as results:
        results.put_bytes(b"a model")
        results.commit(lambda unit, row: "done")


def test_whoever_cancels_at_the_last_moment_gets_nothing(services: Services, sequence_folder: Path):
    sequence = seeds.captured(services, sequence_folder)
    job_id = seeds.queued_training(services, sequence, 1.0)
    with services.unit_of_work() as unit:
        job = unit.jobs.get(job_id)
        job.state, job.attempt, job.cancel_requested = JobState.RUNNING, 1, True
        unit.commit()
    before = list(services.objects.list(job.person_id))
    with pytest.raises(JobStopped):
        keep_what_was_made(services, job)
    with services.reading() as unit:
        # its process then ends it as cancelled
        assert unit.jobs.get(job_id).state is JobState.RUNNING
    assert list(services.objects.list(job.person_id)) == before
