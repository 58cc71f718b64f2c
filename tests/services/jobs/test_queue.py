"""The life of a job by the clock: crashes are forgiven a few times, silence is noticed."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from pathlib import Path

import pytest

from capture.errors import NoPersonFound
from db.models import JobKind, JobRow, JobState, SequenceState
from services.composition import build_services
from services.container import Services
from services.jobs.lease import reclaim_expired
from services.jobs.queue import (
    cancel,
    crashed,
    drop_orphans,
    enqueue,
    fail,
    finish,
    interrupted,
    resume,
    wait_for_room,
)
from services.problems import stored_failure
from services.settings import Settings
from tests.fakes import Clock
from tests.services import seeds
from tests.services.conftest import stored_files


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def services(settings: Settings, clock: Clock) -> Iterator[Services]:
    made = build_services(settings, clock=clock)
    made.database.migrate()
    yield made
    made.close()


def _claim(services: Services) -> JobRow:
    with services.unit_of_work() as unit:
        job = unit.jobs.claim(list(JobKind), "a worker", services.clock())
        unit.commit()
    assert job is not None
    return job


def test_a_job_is_given_up_after_its_last_crash(services: Services, sequence_folder: Path):
    job_id = seeds.queued_training(services, seeds.captured(services, sequence_folder))
    for last in (False, False, True):
        job = _claim(services)
        with services.unit_of_work() as unit:
            job = unit.jobs.get(job_id)
            crashed(
                unit, job, "its process was killed", services.clock(), stored_failure, at_most=3
            )
            unit.commit()
        assert job.state is (JobState.FAILED if last else JobState.QUEUED)
    assert job.error is not None
    assert job.error["type"] == "urn:metanerf:worker-died"
    assert "died 3 times, lately: its process was killed" in job.error["detail"]


def test_a_store_that_is_away_ends_no_job_however_often(services: Services, sequence_folder: Path):
    job_id = seeds.queued_training(services, seeds.captured(services, sequence_folder))
    for _ in range(5):
        _claim(services)
        with services.unit_of_work() as unit:
            job = unit.jobs.get(job_id)
            interrupted(unit, job, "the object store was away", services.clock())
            unit.commit()
        assert (job.state, job.crashes, job.worker) == (JobState.QUEUED, 0, None)
        assert job.message == "the object store was away; trying again"
    job = _claim(services)
    with services.unit_of_work() as unit:
        job = unit.jobs.get(job_id)
        job.cancel_requested = True
        interrupted(unit, job, "the object store was away", services.clock())
        unit.commit()
    assert job.state is JobState.CANCELLED


def test_silence_is_noticed_by_the_clock(services: Services, clock: Clock, sequence_folder: Path):
    job_id = seeds.queued_training(services, seeds.captured(services, sequence_folder))
    _claim(services)

    def revived() -> list[str]:
        with services.unit_of_work() as unit:
            found, _ = reclaim_expired(unit, clock(), 30.0, stored_failure, at_most=3)
            unit.commit()
        return found

    clock.advance(seconds=29)
    assert revived() == []
    clock.advance(seconds=2)
    assert revived() == [job_id]
    assert revived() == []
    assert _claim(services).attempt == 2


def test_a_capture_that_is_given_up_takes_its_upload_along(
    services: Services, clock: Clock, sequence_folder: Path
):
    sequence = seeds.captured(services, sequence_folder)
    with services.unit_of_work() as unit:
        uploaded = unit.sequences.get(sequence.id)
        uploaded.state = SequenceState.UPLOADED
        job_id = enqueue(unit, JobKind.CAPTURE, uploaded, {}, clock()).id
        unit.commit()
    _claim(services)
    with services.unit_of_work() as unit:
        orphans = crashed(
            unit, unit.jobs.get(job_id), "it died", clock(), stored_failure, at_most=1
        )
        unit.commit()
    drop_orphans(services, orphans)
    with services.reading() as unit:
        assert unit.sequences.of_person(sequence.person_id) == []
        job = unit.jobs.get(job_id)
    assert (job.state, job.sequence_id) == (JobState.FAILED, None)
    assert sequence.source_sha256 not in {p.name for p in stored_files(services.settings)}


def test_a_capture_that_is_given_up_ends_the_training_and_lists_its_likeness_no_more(
    services: Services, clock: Clock, sequence_folder: Path
):
    sequence = seeds.captured(services, sequence_folder)
    model = seeds.trained(services, sequence)
    with services.unit_of_work() as unit:
        clip = unit.sequences.get(sequence.id)
        clip.state = SequenceState.CAPTURING
        capture = enqueue(unit, JobKind.CAPTURE, clip, {}, clock())
        training = enqueue(unit, JobKind.TRAIN, clip, {}, clock())
        assert training.message == "waiting for the capture"
        training.model_id = model.id
        unit.commit()
    with services.unit_of_work() as unit:
        fail(unit, unit.jobs.get(capture.id), NoPersonFound("nobody"), clock(), stored_failure)
        unit.commit()
    with services.reading() as unit:
        over = unit.jobs.get(training.id)
        assert (over.state, over.model_id, over.sequence_id) == (JobState.FAILED, None, None)
        assert over.error == unit.jobs.get(capture.id).error
        # whoever meets the likeness may go on to
        assert unit.models.of_person(model.person_id) == []
        assert unit.models.get(model.id).superseded_at == clock()


def test_a_training_whose_clip_is_captured_waits_for_a_worker(
    services: Services, clock: Clock, sequence_folder: Path
):
    sequence = seeds.captured(services, sequence_folder)
    with services.unit_of_work() as unit:
        clip = unit.sequences.get(sequence.id)
        clip.state = SequenceState.CAPTURING
        capture = enqueue(unit, JobKind.CAPTURE, clip, {}, clock())
        training = enqueue(unit, JobKind.TRAIN, clip, {}, clock())
        finish(unit, capture, JobState.SUCCEEDED, clock())
        unit.commit()
    assert training.message == "waiting for a worker"


def test_a_cancelled_job_that_crashes_is_cancelled(services: Services, sequence_folder: Path):
    job_id = seeds.queued_training(services, seeds.captured(services, sequence_folder))
    _claim(services)
    with services.unit_of_work() as unit:
        job = unit.jobs.get(job_id)
        job.cancel_requested = True
        crashed(unit, job, "it died", services.clock(), stored_failure, at_most=3)
        unit.commit()
    assert job.state is JobState.CANCELLED


FULL = OSError(errno.ENOSPC, "No space left on device")


def _finds_it_full(services: Services) -> JobRow:
    """The job that is claimed now, after it found a disk full."""
    job_id = _claim(services).id
    with services.unit_of_work() as unit:
        job = unit.jobs.get(job_id)
        wait_for_room(unit, job, FULL, services.clock(), stored_failure)
        unit.commit()
    return job


def _claimable(services: Services) -> dict[JobKind, int]:
    with services.reading() as unit:
        return unit.jobs.waiting(list(JobKind), services.clock())


def test_a_job_waits_for_room_longer_each_time_and_gives_up_after_a_day(
    services: Services, clock: Clock, sequence_folder: Path
):
    seeds.queued_training(services, seeds.captured(services, sequence_folder))
    waits: list[float] = []
    job = _finds_it_full(services)
    while job.state is JobState.QUEUED:
        assert job.error is not None
        assert job.error["status"] == 507
        assert job.not_before is not None
        waits.append((job.not_before - clock()).total_seconds())
        assert _claimable(services) == {}
        clock.advance(seconds=waits[-1])
        assert _claimable(services) == {JobKind.TRAIN: 1}
        job = _finds_it_full(services)
    assert waits[:8] == [5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 300.0, 300.0]
    assert 23 * 3600.0 < sum(waits) < 25 * 3600.0
    assert job.state is JobState.FAILED
    with services.unit_of_work() as unit:
        job = unit.jobs.get(job.id)
        resume(unit, job)  # by hand it gets another day
        unit.commit()
    assert (job.state, job.full_disks, job.error) == (JobState.QUEUED, 0, None)


def test_what_waits_for_room_keeps_its_checkpoint_and_may_be_hurried_or_cancelled(
    services: Services, sequence_folder: Path
):
    sequence = seeds.captured(services, sequence_folder)
    job_id = seeds.queued_training(services, sequence)
    stored = services.objects.put(sequence.person_id, [b"where it stood"])
    with services.unit_of_work() as unit:
        unit.jobs.get(job_id).checkpoint_sha256 = stored.sha256
        unit.commit()
    assert _finds_it_full(services).checkpoint_sha256 == stored.sha256
    with services.unit_of_work() as unit:
        resume(unit, unit.jobs.get(job_id))
        unit.commit()
    again = _finds_it_full(services)
    assert (again.full_disks, again.checkpoint_sha256) == (1, stored.sha256)
    with services.unit_of_work() as unit:
        job = unit.jobs.get(job_id)
        cancel(unit, job, services.clock())
        unit.commit()
    assert (job.state, job.not_before) == (JobState.CANCELLED, None)


def test_who_cancels_while_the_disk_is_found_full_is_heard(
    services: Services, sequence_folder: Path
):
    job_id = seeds.queued_training(services, seeds.captured(services, sequence_folder))
    claimed = _claim(services)
    with services.unit_of_work() as unit:
        job = unit.jobs.get(claimed.id)
        job.cancel_requested = True
        wait_for_room(unit, job, FULL, services.clock(), stored_failure)
        unit.commit()
    assert (job.id, job.state) == (job_id, JobState.CANCELLED)
