"""Runs queued trainings here, without a worker."""

from __future__ import annotations

from pathlib import Path

from db.models import JobKind, JobRow
from services.container import Services
from services.jobs.lease import JobLease
from services.jobs.report import Reporter
from services.jobs.train_job import run_train


def run_next_training(services: Services, folder: Path) -> JobRow:
    """The job once it has run, in this process and in `folder`, which is made."""
    with services.unit_of_work() as unit:
        job = unit.jobs.claim([JobKind.TRAIN], "a test", services.clock())
        assert job is not None
        unit.commit()
    folder.mkdir()
    with Reporter(services, JobLease(job.id, job.person_id, job.attempt)) as reporter:
        run_train(services, job, reporter, folder)
    with services.reading() as unit:
        return unit.jobs.get(job.id)
