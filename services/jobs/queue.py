"""What can be done with a job: queue it, cancel it, resume it, queue it again, end it.

A training may be queued before its clip is captured, and waits for that. A capture that fails or
is cancelled takes its sequence and such trainings with it, since there is nothing to be had from
it; the jobs stay and say why. Only a full disk is not the clip's fault: then the clip stays, and
the job waits for room and is tried again. All functions work within the caller's transaction; those
that end a job return the objects that nothing points at afterwards, for the caller to delete once
the transaction is committed.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any

from db.errors import NotFound, StoreFull
from db.models import JobKind, JobRow, JobState, SequenceRow, SequenceState, new_id
from db.objects import no_space
from db.repositories import UnitOfWork
from services.container import Services
from services.errors import ClipGone, JobOver, NotResumable, SequenceInUse, WorkerDied

STORE_AWAY = os.EX_TEMPFAIL
"""Exit code of a job's process from under which the database or the object store went away."""
Orphan = tuple[str, str]
"""Owner and sha256 of an object."""
DescribeFailure = Callable[[Exception], dict[str, Any]]
"""What a job's row keeps of the error that ended it, with what people read as `detail`."""
_WAITING, _WAITING_FOR_CAPTURE = "waiting for a worker", "waiting for the capture"


_SHORTEST_WAIT_S, _LONGEST_WAIT_S = 5.0, 300.0
_MOST_FULL_DISKS = 290
"""After which a job fails that found a disk full each time; with the longest wait, a day."""


def enqueue(
    unit: UnitOfWork,
    kind: JobKind,
    sequence: SequenceRow,
    params: dict[str, Any],
    now: datetime,
    traceparent: str | None = None,
) -> JobRow:
    """Queue work on `sequence`; `traceparent`: within which span it was asked for."""
    captured = sequence.state is SequenceState.READY or kind is not JobKind.TRAIN
    job = JobRow(
        id=new_id(),
        person_id=sequence.person_id,
        kind=kind,
        state=JobState.QUEUED,
        params=params,
        created_at=now,
        sequence_id=sequence.id,
        message=_WAITING if captured else _WAITING_FOR_CAPTURE,
        progress=0.0,
        preview_version=0,
        attempt=0,
        crashes=0,
        cancel_requested=False,
        traceparent=traceparent,
    )
    unit.jobs.add(job)
    return job


def cancel(unit: UnitOfWork, job: JobRow, now: datetime) -> list[Orphan]:
    """Cancel at once what waits; ask what runs to stop. Raises JobOver for what has ended."""
    if job.state.final:
        raise JobOver(f"a job must be queued or running to be cancelled; got {job.state}")
    if job.state is JobState.QUEUED:
        return finish(unit, job, JobState.CANCELLED, now, message="cancelled")
    job.cancel_requested = True
    job.message = "stopping"
    return []


def frames_of(unit: UnitOfWork, job: JobRow) -> str:
    """sha256 of the captured frames that a training learns from. Raises ClipGone."""
    packed = unit.sequences.get(job.sequence_id).packed_sha256 if job.sequence_id else None
    if packed is None:
        raise clip_gone()
    return packed


def clip_gone() -> ClipGone:
    """Why a job without its clip, or the frames captured from it, can't be done."""
    return ClipGone(
        "the clip and the frames of a job must be stored; got a job whose are gone and cannot come "
        "back; upload the clip again",
    )


def resume(unit: UnitOfWork, job: JobRow) -> None:
    """Queue a cancelled or failed job again, or one that waits for room at once; a training goes
    on from its checkpoint.

    Raises NotResumable for a job that is not over, or whose sequence is gone; ClipGone where that
    was only for a model that is made.
    """
    waits_for_room = job.state is JobState.QUEUED and job.not_before is not None
    over = job.state in (JobState.CANCELLED, JobState.FAILED)
    if not (over or waits_for_room) or job.sequence_id is None:
        raise NotResumable(
            "only a job of a stored sequence that was cancelled, failed or waits for room can be "
            "resumed; got a "
            f"{job.kind} job that is {job.state}; start a new one",
        )
    if unit.sequences.get(job.sequence_id).state is SequenceState.FORGOTTEN:
        raise clip_gone()
    job.state, job.error, job.finished_at = JobState.QUEUED, None, None
    job.cancel_requested, job.crashes, job.full_disks = False, 0, 0
    job.not_before = None
    job.message = _WAITING


def requeue(job: JobRow, message: str) -> None:
    """Queue a running job again, for whoever is free."""
    job.state, job.worker, job.heartbeat_at = JobState.QUEUED, None, None
    job.message = message


def interrupted(unit: UnitOfWork, job: JobRow, reason: str, now: datetime) -> list[Orphan]:
    """A running job could not go on, for no fault of its own: try again, as often as it takes."""
    if job.cancel_requested:
        return finish(unit, job, JobState.CANCELLED, now, message="cancelled")
    requeue(job, f"{reason}; trying again")
    return []


def is_full(error: Exception) -> bool:
    """Whether `error` is that a disk is full."""
    return isinstance(error, StoreFull) or no_space(error) is not None


def wait_for_room(
    unit: UnitOfWork, job: JobRow, error: Exception, now: datetime, describe: DescribeFailure
) -> list[Orphan]:
    """A running job found a disk full: keep its clip and checkpoint, and try again, after twice as
    long each time. It fails once it has waited for about a day."""
    if job.cancel_requested:
        return finish(unit, job, JobState.CANCELLED, now, message="cancelled")
    job.full_disks += 1
    if job.full_disks > _MOST_FULL_DISKS:
        return fail(unit, job, error, now, describe)
    job.error = described = describe(error)
    requeue(job, f"waiting for room: {described['detail']}"[:500])
    doubled_s = _SHORTEST_WAIT_S * 2.0 ** min(job.full_disks - 1, 10)
    job.not_before = now + timedelta(seconds=min(doubled_s, _LONGEST_WAIT_S))
    _keep_clip(unit, job)
    return []


def crashed(
    unit: UnitOfWork,
    job: JobRow,
    reason: str,
    now: datetime,
    describe: DescribeFailure,
    *,
    at_most: int,
) -> list[Orphan]:
    """A running job's process is gone: try again, or give up after `at_most` times."""
    job.crashes += 1
    if job.cancel_requested or job.crashes < at_most:
        return interrupted(unit, job, reason, now)
    error = WorkerDied(
        f"a job's process must live; it died {job.crashes} times, lately: {reason}",
    )
    return fail(unit, job, error, now, describe)


def finish(
    unit: UnitOfWork, job: JobRow, state: JobState, now: datetime, *, message: str = ""
) -> list[Orphan]:
    """End a job that succeeded or was cancelled."""
    job.state, job.finished_at, job.not_before = state, now, None
    job.message, job.error = message[:500], None
    if state is JobState.SUCCEEDED:
        job.progress = 1.0
        for training in _waiting_for(unit, job):
            training.message = _WAITING
        return drop_checkpoint(job) + _forget_frames(unit, job)
    return (
        _discard_sequence(unit, job) if job.kind is JobKind.CAPTURE else _forget_frames(unit, job)
    )


def fail(
    unit: UnitOfWork, job: JobRow, error: Exception, now: datetime, describe: DescribeFailure
) -> list[Orphan]:
    """End a job for `error`, of which the row keeps what `describe` gives."""
    job.state, job.finished_at = JobState.FAILED, now
    job.error = described = describe(error)
    job.message = described["detail"][:500]
    if job.kind is not JobKind.CAPTURE:
        return _forget_frames(unit, job)
    if is_full(error):
        _keep_clip(unit, job)
        return []
    return _discard_sequence(unit, job)


def discard(unit: UnitOfWork, sequence: SequenceRow) -> list[Orphan]:
    """Remove a clip with its frames, its motion, its jobs' pictures of it, and the pictures of live
    look that were kept to be trained on with it; models stay.

    Raises SequenceInUse while a job works on it.
    """
    jobs = unit.jobs.of_sequence(sequence.id)
    for job in jobs:
        if not job.state.final:
            raise SequenceInUse(
                "a sequence must have no job queued or running to be deleted; got the "
                f"{job.kind} job {job.id}, which is {job.state}; cancel it and wait for its end",
            )
    motion = unit.motions.of_sequence(sequence.id)
    objects = {sequence.source_sha256, sequence.packed_sha256, sequence.thumbnail_sha256}
    objects.add(motion.sha256 if motion else None)
    orphans = [(sequence.person_id, sha256) for sha256 in objects if sha256 is not None]
    for kept in unit.sequences.of_person(sequence.person_id):
        if kept.clip_id == sequence.id:  # nobody could train from them any more
            orphans += discard(unit, kept)
    for job in jobs:
        orphans += drop_checkpoint(job)
        job.sequence_id, job.preview, job.preview_version = None, None, 0
    unit.flush()
    unit.sequences.remove(sequence)
    return orphans


def drop_orphans(services: Services, orphans: list[Orphan]) -> None:
    """Delete those objects to which no row points (any more)."""
    for owner, sha256 in orphans:
        with services.reading() as unit:
            used = sha256 in unit.references.of_owner(owner)
        if not used:
            services.objects.delete(owner, sha256)


def drop_checkpoint(job: JobRow) -> list[Orphan]:
    """Forget where a training stood."""
    if job.checkpoint_sha256 is None:
        return []
    orphan = (job.person_id, job.checkpoint_sha256)
    job.checkpoint_sha256 = None
    return [orphan]


def _forget_frames(unit: UnitOfWork, job: JobRow) -> list[Orphan]:
    """Let go of a clip that was for one model alone, once that is made and nobody trains from it
    any more."""
    if job.kind is not JobKind.TRAIN or job.sequence_id is None:
        return []
    sequence, jobs = unit.sequences.get(job.sequence_id), unit.jobs.of_sequence(job.sequence_id)
    made = any(one.kind is JobKind.TRAIN and one.state is JobState.SUCCEEDED for one in jobs)
    if not (sequence.model_only and made) or any(not one.state.final for one in jobs):
        return []
    return forget(sequence, jobs)


def forget(sequence: SequenceRow, jobs: list[JobRow]) -> list[Orphan]:
    """Let go of a sequence's pictures, and of those that its `jobs` show; the row stays."""
    gone = {sequence.source_sha256, sequence.packed_sha256, sequence.thumbnail_sha256}
    orphans = [(sequence.person_id, sha256) for sha256 in gone if sha256 is not None]
    # not even the clip's fingerprint stays; what takes its place names no object
    sequence.source_sha256 = hashlib.sha256(f"forgotten {sequence.id}".encode()).hexdigest()
    sequence.packed_sha256 = sequence.thumbnail_sha256 = None
    sequence.state = SequenceState.FORGOTTEN
    for one in jobs:
        orphans += drop_checkpoint(one)
        one.preview, one.preview_version = None, 0
    return orphans


def _keep_clip(unit: UnitOfWork, job: JobRow) -> None:
    """Have the clip of a capture that could not go on be there for the next attempt."""
    if job.kind is JobKind.CAPTURE and job.sequence_id is not None:
        unit.sequences.get(job.sequence_id).state = SequenceState.UPLOADED


def _discard_sequence(unit: UnitOfWork, job: JobRow) -> list[Orphan]:
    if job.sequence_id is None:
        return []
    try:
        sequence = unit.sequences.get(job.sequence_id)
    except NotFound:
        return []
    if sequence.state is SequenceState.READY:
        return []
    for training in _waiting_for(unit, job):
        _give_up_with(unit, training, job)
    job.sequence_id = None
    unit.flush()
    unit.sequences.remove(sequence)
    return [(sequence.person_id, sequence.source_sha256)]


def _waiting_for(unit: UnitOfWork, capture: JobRow) -> list[JobRow]:
    """The trainings that wait for the clip of `capture`."""
    if capture.kind is not JobKind.CAPTURE or capture.sequence_id is None:
        return []
    jobs = unit.jobs.of_sequence(capture.sequence_id)
    return [job for job in jobs if job.kind is JobKind.TRAIN and job.state is JobState.QUEUED]


def _give_up_with(unit: UnitOfWork, training: JobRow, capture: JobRow) -> None:
    """End a training whose clip is gone, for its capture's reason, and list its first likeness no
    more; whoever meets that likeness keeps it."""
    if training.model_id is not None:
        unit.models.get(training.model_id).superseded_at = capture.finished_at
    training.model_id = training.sequence_id = None
    training.state, training.finished_at = capture.state, capture.finished_at
    training.message, training.error = capture.message, capture.error
