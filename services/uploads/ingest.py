"""Checks and stores an upload: bytes first, then sequence and capture job in one transaction."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from capture.errors import CaptureError
from db.errors import Conflict
from db.models import (
    AuditEventRow,
    JobKind,
    JobState,
    MotionRow,
    SequenceKind,
    SequenceRow,
    SequenceState,
    UploadRow,
    new_id,
)
from db.objects import StoredObject, file_chunks
from db.repositories import UnitOfWork
from services.container import Services
from services.jobs.events import QUEUE, job_topic
from services.jobs.queue import Orphan, drop_orphans, enqueue, resume
from services.motions import motion_bytes
from services.uploads.apart import check_upload_apart
from services.uploads.check import Checked

_LONGEST_NAME = 80
"""Characters, so that the name of a file is at most 255 bytes long in UTF-8."""


@dataclass(frozen=True)
class ReceivedFile:
    """A file that was received completely."""

    person_id: str
    account: str
    path: Path
    filename: str
    sha256: str


def existing_sequence(services: Services, person_id: str, sha256: str) -> SequenceRow | None:
    """The sequence that was made of the same bytes before, if any: a retry is free.

    Where its capture failed or waits for room, it is tried at once, which is what whoever sends
    the clip again wants.
    """
    with services.unit_of_work() as unit:
        known = unit.sequences.with_source(person_id, sha256)
        capture = known and unit.jobs.latest(known.id, JobKind.CAPTURE)
        if capture and (capture.state is JobState.FAILED or capture.not_before is not None):
            resume(unit, capture)
        unit.commit()
    if capture:
        services.events.publish(QUEUE)
        services.events.publish(job_topic(capture.id))
    return known


def ingest(services: Services, received: ReceivedFile) -> SequenceRow:
    """Check and store `received`. Where it raises (CaptureError, StoreFull), nothing stays."""
    name = safe_name(received.filename)
    # under its sender's name for it, which error messages contain
    path = received.path.rename(received.path.with_name(name))
    checked = _check(path, name)
    put: list[Orphan] = []
    try:
        source = _put(services, received, file_chunks(path), put)
        motion = None
        if checked.motion is not None:
            motion = _put(services, received, [motion_bytes(checked.motion)], put)
        with services.unit_of_work() as unit:
            sequence = _write(services, unit, received, name, source, checked, motion)
            unit.commit()
    except Conflict:  # the same bytes came twice at once
        drop_orphans(services, put)
        known = existing_sequence(services, received.person_id, received.sha256)
        if known is None:
            raise
        return known
    except BaseException:
        drop_orphans(services, put)
        raise
    services.events.publish(QUEUE)
    return sequence


def end_upload(unit: UnitOfWork, upload: UploadRow) -> list[Orphan]:
    """Remove an upload's rows; returns its chunks for deletion."""
    orphans = [(upload.person_id, chunk.sha256) for chunk in upload.chunks]
    unit.uploads.remove(upload)
    return orphans


def safe_name(filename: str) -> str:
    """The last part of a file's name, for people and for its suffix only; never a path."""
    last = PurePosixPath(filename.replace("\\", "/")).name
    kept = "".join(c for c in last if c.isprintable() and c not in '<>:"|?*').strip(". ")
    return kept[-_LONGEST_NAME:] or "upload"


def _check(path: Path, name: str) -> Checked:
    try:
        return check_upload_apart(path, name)
    except CaptureError as error:  # FFmpeg's messages contain the path on this server
        raise type(error)(str(error).replace(f"{path.parent}/", "")) from error


def _put(
    services: Services, received: ReceivedFile, chunks: Iterable[bytes], put: list[Orphan]
) -> StoredObject:
    stored = services.objects.put(received.person_id, chunks)
    put.append((received.person_id, stored.sha256))
    return stored


def _write(
    services: Services,
    unit: UnitOfWork,
    received: ReceivedFile,
    name: str,
    source: StoredObject,
    checked: Checked,
    motion: StoredObject | None,
) -> SequenceRow:
    now = services.clock()
    ready = checked.motion
    sequence = SequenceRow(
        id=new_id(),
        person_id=received.person_id,
        kind=checked.kind,
        state=SequenceState.READY if ready else SequenceState.UPLOADED,
        created_at=now,
        source_name=name,
        source_sha256=source.sha256,
        frames=len(ready) if ready else None,
        duration_s=ready.duration_s if ready else None,
    )
    unit.sequences.add(sequence)
    unit.flush()
    if ready is not None and motion is not None:
        span = ready.duration_s
        sequence.frames_per_second = (len(ready) - 1) / span if span > 0.0 else None
        unit.motions.add(
            MotionRow(
                person_id=received.person_id,
                sequence_id=sequence.id,
                frames=len(ready),
                duration_s=span,
                sha256=motion.sha256,
            )
        )
    if checked.kind is not SequenceKind.KEYPOINTS:
        enqueue(unit, JobKind.CAPTURE, sequence, {}, now, services.tracing.here())
    unit.audit.add(
        AuditEventRow(
            person_id=received.person_id,
            at=now,
            account=received.account,
            action="sequence.uploaded",
            details={"kind": str(checked.kind), "bytes": source.bytes},
        )
    )
    return sequence
