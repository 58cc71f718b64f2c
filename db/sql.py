"""Repositories on SQLAlchemy; the same statements on SQLite and PostgreSQL."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from datetime import datetime
from typing import Any, cast

from sqlalchemy import (
    ColumnElement,
    CursorResult,
    Select,
    Table,
    and_,
    delete,
    func,
    or_,
    select,
    update,
)

from db.models import (
    AuditEventRow,
    Base,
    JobKind,
    JobRow,
    JobState,
    ModelRow,
    MotionRow,
    PerformerRow,
    PersonRow,
    RecordingChunkRow,
    SequenceRow,
    SequenceState,
    UploadRow,
)
from db.repositories import Holdings
from db.sql_repository import SqlRepository


def _is_of(account: str) -> ColumnElement[bool]:
    return PersonRow.account == account


class SqlPeople(SqlRepository):
    """Persons."""

    def add(self, person: PersonRow) -> None:
        """See `People.add`."""
        self._session.add(person)

    def get(self, person_id: str) -> PersonRow:
        """See `People.get`."""
        return self._get(PersonRow, person_id, "person")

    def among(self, person_ids: Collection[str]) -> set[str]:
        """See `People.among`."""
        return set(self._session.scalars(select(PersonRow.id).where(PersonRow.id.in_(person_ids))))

    def of_account(self, account: str) -> list[PersonRow]:
        """See `People.of_account`."""
        query = select(PersonRow).where(PersonRow.account == account)
        return list(self._session.scalars(query.order_by(PersonRow.created_at)))

    def holdings(self, account: str) -> Holdings:
        """See `People.holdings`."""
        people = list(self._session.scalars(select(PersonRow.id).where(_is_of(account))))
        uploads = select(UploadRow).join(PersonRow, PersonRow.id == UploadRow.person_id)
        open_trainings = and_(
            JobRow.kind == JobKind.TRAIN,
            JobRow.state.in_([JobState.QUEUED, JobState.RUNNING]),
            JobRow.model_id.is_(None),
        )
        return Holdings(
            people=people,
            sequences=self._number(SequenceRow, account),
            models=self._number(ModelRow, account) + self._number(JobRow, account, open_trainings),
            coming_bytes=sum(
                one.size - one.offset
                for one in self._session.scalars(uploads.where(_is_of(account)))
            ),
        )

    def _number(
        self,
        table: type[SequenceRow] | type[ModelRow] | type[JobRow],
        account: str,
        *conditions: ColumnElement[bool],
    ) -> int:
        query = select(func.count()).select_from(table)
        query = query.join(PersonRow, PersonRow.id == table.person_id)
        return self._session.scalar(query.where(_is_of(account), *conditions)) or 0

    def erase(self, person_id: str) -> dict[str, int]:
        """See `People.erase`."""
        self.get(person_id)
        erased = {}
        # children first: the counts are then exact, where a cascade would tell nothing
        for table in reversed(_tables_of_persons()):
            statement = delete(table).where(table.c.person_id == person_id)
            erased[table.name] = _count(self._session.execute(statement))
        statement = delete(PersonRow).where(PersonRow.id == person_id)
        erased["person"] = _count(self._session.execute(statement))
        self._session.expire_all()
        return {name: count for name, count in erased.items() if count}

    def count_rows(self, person_id: str) -> int:
        """See `People.count_rows`."""
        queries = [
            select(func.count()).select_from(table).where(table.c.person_id == person_id)
            for table in _tables_of_persons()
        ]
        queries.append(select(func.count()).where(PersonRow.id == person_id))
        return sum(self._session.scalar(query) or 0 for query in queries)


class SqlUploads(SqlRepository):
    """Resumable uploads under way."""

    def add(self, upload: UploadRow) -> None:
        """See `Uploads.add`."""
        self._session.add(upload)

    def get(self, upload_id: str) -> UploadRow:
        """See `Uploads.get`."""
        return self._get(UploadRow, upload_id, "upload")

    def with_content(self, person_id: str, sha256: str) -> UploadRow | None:
        """See `Uploads.with_content`."""
        query = select(UploadRow).where(
            UploadRow.person_id == person_id, UploadRow.sha256 == sha256
        )
        return self._session.scalars(query.limit(1)).first()

    def remove(self, upload: UploadRow) -> None:
        """See `Uploads.remove`."""
        self._session.delete(upload)

    def started_before(self, moment: datetime) -> list[UploadRow]:
        """See `Uploads.started_before`."""
        return list(self._session.scalars(select(UploadRow).where(UploadRow.created_at < moment)))


class SqlSequences(SqlRepository):
    """Clips."""

    def add(self, sequence: SequenceRow) -> None:
        """See `Sequences.add`."""
        self._session.add(sequence)

    def get(self, sequence_id: str) -> SequenceRow:
        """See `Sequences.get`."""
        return self._get(SequenceRow, sequence_id, "sequence")

    def of_person(self, person_id: str) -> list[SequenceRow]:
        """See `Sequences.of_person`."""
        query = select(SequenceRow).where(SequenceRow.person_id == person_id)
        return list(self._session.scalars(query.order_by(SequenceRow.created_at)))

    def created_before(self, moment: datetime) -> list[SequenceRow]:
        """See `Sequences.created_before`."""
        query = select(SequenceRow).where(SequenceRow.created_at < moment)
        return list(self._session.scalars(query.order_by(SequenceRow.created_at)))

    def with_source(self, person_id: str, sha256: str) -> SequenceRow | None:
        """See `Sequences.with_source`."""
        query = select(SequenceRow).where(
            SequenceRow.person_id == person_id, SequenceRow.source_sha256 == sha256
        )
        return self._session.scalars(query).one_or_none()

    def remove(self, sequence: SequenceRow) -> None:
        """See `Sequences.remove`."""
        self._session.delete(sequence)


class SqlMotions(SqlRepository):
    """Motions of sequences."""

    def add(self, motion: MotionRow) -> None:
        """See `Motions.add`."""
        self._session.add(motion)

    def of_sequence(self, sequence_id: str) -> MotionRow | None:
        """See `Motions.of_sequence`."""
        query = select(MotionRow).where(MotionRow.sequence_id == sequence_id)
        return self._session.scalars(query).one_or_none()


class SqlModels(SqlRepository):
    """Trained models."""

    def add(self, model: ModelRow) -> None:
        """See `Models.add`."""
        self._session.add(model)

    def get(self, model_id: str) -> ModelRow:
        """See `Models.get`."""
        return self._get(ModelRow, model_id, "model")

    def of_person(self, person_id: str) -> list[ModelRow]:
        """See `Models.of_person`."""
        query = select(ModelRow).where(ModelRow.person_id == person_id)
        return self._best(query)

    def of_account(self, account: str) -> list[ModelRow]:
        """See `Models.of_account`."""
        query = select(ModelRow).join(PersonRow).where(PersonRow.account == account)
        return self._best(query)

    def supersede(self, model_id: str, better: ModelRow, now: datetime) -> list[str]:
        """See `Models.supersede`."""
        worse = self._session.get(ModelRow, model_id)
        if worse is None:  # erased meanwhile
            return []
        worse.superseded_at = now
        query = select(PerformerRow).where(PerformerRow.model_id == model_id)
        performers = list(self._session.scalars(query))
        for performer in performers:
            performer.model_id = better.id
        return sorted({performer.meeting_id for performer in performers})

    def superseded_before(self, moment: datetime) -> list[ModelRow]:
        """See `Models.superseded_before`."""
        performing = select(PerformerRow.model_id)
        query = select(ModelRow).where(
            ModelRow.superseded_at < moment, ModelRow.id.not_in(performing)
        )
        return list(self._session.scalars(query))

    def remove(self, model: ModelRow) -> None:
        """See `Models.remove`."""
        self._session.delete(model)

    def _best(self, query: Select[ModelRow]) -> list[ModelRow]:
        query = query.where(ModelRow.superseded_at.is_(None)).order_by(ModelRow.created_at)
        return list(self._session.scalars(query))


class SqlJobs(SqlRepository):
    """The queue, and what became of its jobs."""

    def add(self, job: JobRow) -> None:
        """See `Jobs.add`."""
        self._session.add(job)

    def get(self, job_id: str) -> JobRow:
        """See `Jobs.get`."""
        return self._get(JobRow, job_id, "job")

    def waiting(self, kinds: Collection[JobKind], now: datetime) -> dict[JobKind, int]:
        """See `Jobs.waiting`."""
        query = select(JobRow.kind, func.count()).where(*_claimable(kinds, now))
        query = query.group_by(JobRow.kind)
        return {kind: int(count) for kind, count in self._session.execute(query)}

    def claim(self, kinds: Collection[JobKind], worker: str, now: datetime) -> JobRow | None:
        """See `Jobs.claim`."""
        # PostgreSQL skips rows that another worker holds; SQLite has one writer at a time anyway
        query = (
            select(JobRow)
            .where(*_claimable(kinds, now))
            .order_by(JobRow.created_at)
            .limit(1)
            .with_for_update(skip_locked=True)
        )
        job = self._session.scalars(query).first()
        if job is not None:
            job.state, job.worker, job.heartbeat_at = JobState.RUNNING, worker, now
            job.not_before = job.error = None
            job.attempt += 1
        return job

    def with_expired_lease(self, renewed_before: datetime) -> list[JobRow]:
        """See `Jobs.with_expired_lease`."""
        query = (
            select(JobRow)
            .where(JobRow.state == JobState.RUNNING, JobRow.heartbeat_at < renewed_before)
            .with_for_update(skip_locked=True)
        )
        return list(self._session.scalars(query))

    def write(self, job_id: str, attempt: int, values: dict[str, Any]) -> bool:
        """See `Jobs.write`."""
        statement = (
            update(JobRow)
            .where(
                JobRow.id == job_id,
                JobRow.state == JobState.RUNNING,
                JobRow.attempt == attempt,
            )
            .values(values)
        )
        return _count(self._session.execute(statement)) == 1

    def latest(self, sequence_id: str, kind: JobKind) -> JobRow | None:
        """See `Jobs.latest`."""
        query = select(JobRow).where(JobRow.sequence_id == sequence_id, JobRow.kind == kind)
        return self._session.scalars(query.order_by(JobRow.created_at.desc()).limit(1)).first()

    def of_sequence(self, sequence_id: str) -> list[JobRow]:
        """See `Jobs.of_sequence`."""
        return list(self._session.scalars(select(JobRow).where(JobRow.sequence_id == sequence_id)))

    def preview(self, job_id: str) -> bytes | None:
        """See `Jobs.preview`."""
        return self._session.scalar(select(JobRow.preview).where(JobRow.id == job_id))

    def count(self) -> dict[tuple[str, str], int]:
        """See `Jobs.count`."""
        query = select(JobRow.kind, JobRow.state, func.count()).group_by(JobRow.kind, JobRow.state)
        return {(kind, state): count for kind, state, count in self._session.execute(query)}


class SqlAuditLog(SqlRepository):
    """Who did what, when."""

    def add(self, event: AuditEventRow) -> None:
        """See `AuditLog.add`."""
        self._session.add(event)

    def of_account(self, account: str) -> list[AuditEventRow]:
        """See `AuditLog.of_account`."""
        query = select(AuditEventRow).where(AuditEventRow.account == account)
        return list(self._session.scalars(query.order_by(AuditEventRow.at)))

    def forget(self, before: datetime) -> int:
        """See `AuditLog.forget`."""
        old = delete(AuditEventRow).where(AuditEventRow.at < before)
        return _count(self._session.execute(old))


class SqlReferences(SqlRepository):
    """Which objects of the store rows point at, read off the tables themselves."""

    def of_owner(self, owner: str) -> set[str]:
        """See `References.of_owner`."""
        found: set[str] = set()
        for table in _tables_of_persons():
            for column in table.c:
                if column.info.get("object"):
                    query = select(column).where(table.c.person_id == owner, column.is_not(None))
                    found.update(self._session.scalars(query))
        kept = select(RecordingChunkRow.sha256).where(RecordingChunkRow.owner == owner)
        found.update(self._session.scalars(kept))
        return found

    def owners(self, among: Iterable[str]) -> set[str]:
        """See `References.owners`."""
        return set(self._session.scalars(select(PersonRow.id).where(PersonRow.id.in_(among))))


def _tables_of_persons() -> list[Table]:
    """Every table with rows of persons, parents before children."""
    return [table for table in Base.metadata.sorted_tables if "person_id" in table.c]


def _claimable(kinds: Collection[JobKind], now: datetime) -> tuple[ColumnElement[bool], ...]:
    """Queued jobs of `kinds`, but no training whose clip is still to be captured, and none that
    still waits for room."""
    uncaptured = select(SequenceRow.id).where(
        SequenceRow.id == JobRow.sequence_id,
        SequenceRow.state.in_([SequenceState.UPLOADED, SequenceState.CAPTURING]),
    )
    waits_for_capture = and_(JobRow.kind == JobKind.TRAIN, uncaptured.exists())
    may_begin = or_(JobRow.not_before.is_(None), JobRow.not_before <= now)
    return (JobRow.state == JobState.QUEUED, JobRow.kind.in_(kinds), ~waits_for_capture, may_begin)


def _count(result: object) -> int:
    return cast("CursorResult[Any]", result).rowcount
