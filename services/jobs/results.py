"""How a job stores what it made: bytes first, rows last, all of it or nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from db.errors import DatabaseError
from db.models import JobRow, JobState
from db.objects import StoredObject, file_chunks
from db.repositories import UnitOfWork
from services.container import Services
from services.jobs import packing
from services.jobs.events import job_topic
from services.jobs.queue import Orphan, drop_checkpoint, drop_orphans, finish
from services.jobs.report import JobStopped


class Results:
    """Objects of one job until its rows are written; what has no row at the end is deleted."""

    def __init__(self, services: Services, job: JobRow) -> None:
        self._services, self._job = services, job
        self._put: list[Orphan] = []

    def __enter__(self) -> Results:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            return
        try:
            drop_orphans(self._services, self._put)
        except DatabaseError:
            return  # the sweeper will see to it; the first error is the one to tell

    def put_file(self, path: Path) -> StoredObject:
        """Store a file."""
        return self._note(self._services.objects.put(self._job.person_id, file_chunks(path)))

    def put_bytes(self, data: bytes) -> StoredObject:
        """Store bytes."""
        return self._note(self._services.objects.put(self._job.person_id, [data]))

    def pack(self, folder: Path) -> StoredObject:
        """Store a folder."""
        return self._note(packing.pack(self._services.objects, self._job.person_id, folder))

    def commit(self, write: Callable[[UnitOfWork, JobRow], str]) -> None:
        """Write rows and end the job in one transaction; `write` returns the last message.

        Raises JobStopped where this attempt is no longer the one that runs the job, or the job is
        to be cancelled.
        """

        def end(unit: UnitOfWork, job: JobRow) -> list[Orphan]:
            message = write(unit, job)
            return finish(unit, job, JobState.SUCCEEDED, self._services.clock(), message=message)

        self._write(end)

    def commit_interim(self, write: Callable[[UnitOfWork, JobRow], str]) -> None:
        """Write rows of what is done so far; the job goes on, without its checkpoint of before.

        Raises JobStopped as `commit`.
        """

        def go_on(unit: UnitOfWork, job: JobRow) -> list[Orphan]:
            job.message = write(unit, job)
            return drop_checkpoint(job)

        self._write(go_on)
        self._put.clear()
        self._services.events.publish(job_topic(self._job.id))

    def _write(self, change: Callable[[UnitOfWork, JobRow], list[Orphan]]) -> None:
        with self._services.unit_of_work() as unit:
            # the update locks the row, so that nobody takes the job away in between
            if not unit.jobs.write(
                self._job.id, self._job.attempt, {"heartbeat_at": self._services.clock()}
            ):
                raise JobStopped
            job = unit.jobs.get(self._job.id)
            if job.cancel_requested:
                raise JobStopped
            orphans = change(unit, job)
            unit.commit()
        drop_orphans(self._services, orphans)

    def _note(self, stored: StoredObject) -> StoredObject:
        self._put.append((self._job.person_id, stored.sha256))
        return stored
