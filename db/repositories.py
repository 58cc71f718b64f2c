"""What services ask of the database, aggregate by aggregate. `db.sql` answers;
what is asked of meetings is in `db.meeting_repositories`.

`get` raises NotFound; everything else that finds nothing returns None or an empty list. Nothing
here commits: that is the unit of work's.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from datetime import datetime
from types import TracebackType
from typing import Any, Protocol, Self

from db.meeting_repositories import Gateways, Meetings, Recordings
from db.models import (
    AuditEventRow,
    JobKind,
    JobRow,
    ModelRow,
    MotionRow,
    PersonRow,
    SequenceRow,
    UploadRow,
)


@dataclass(frozen=True)
class Holdings:
    """What one account has."""

    people: list[str]
    """Their ids."""
    sequences: int
    models: int
    """And trainings under way, each of which will be one."""
    coming_bytes: int
    """Of uploads under way that have not come yet."""


class People(Protocol):
    """Persons."""

    def add(self, person: PersonRow) -> None:
        """Store a new person, as the transaction commits."""
        ...

    def get(self, person_id: str) -> PersonRow:
        """The person of that id. Raises NotFound."""
        ...

    def among(self, person_ids: Collection[str]) -> set[str]:
        """Those of these ids that a person has."""
        ...

    def of_account(self, account: str) -> list[PersonRow]:
        """All persons of `account`, the oldest first."""
        ...

    def holdings(self, account: str) -> Holdings:
        """What `account` has."""
        ...

    def erase(self, person_id: str) -> dict[str, int]:
        """Delete every row of a person; the number of rows that went, by table. Raises NotFound."""
        ...

    def count_rows(self, person_id: str) -> int:
        """The number of rows, in whatever table, that still belong to a person."""
        ...


class Uploads(Protocol):
    """Resumable uploads under way."""

    def add(self, upload: UploadRow) -> None:
        """Store a new upload, as the transaction commits."""
        ...

    def get(self, upload_id: str) -> UploadRow:
        """The upload of that id. Raises NotFound."""
        ...

    def with_content(self, person_id: str, sha256: str) -> UploadRow | None:
        """The upload under way of the same bytes, to go on with; None where there is none."""
        ...

    def remove(self, upload: UploadRow) -> None:
        """Delete an upload's row; its bytes stay in the store."""
        ...

    def started_before(self, moment: datetime) -> list[UploadRow]:
        """The uploads under way that began before `moment`, in no particular order."""
        ...


class Sequences(Protocol):
    """Clips."""

    def add(self, sequence: SequenceRow) -> None:
        """Store a new sequence, as the transaction commits."""
        ...

    def get(self, sequence_id: str) -> SequenceRow:
        """The sequence of that id. Raises NotFound."""
        ...

    def of_person(self, person_id: str) -> list[SequenceRow]:
        """All sequences of a person, the oldest first."""
        ...

    def created_before(self, moment: datetime) -> list[SequenceRow]:
        """All sequences of before a moment, the oldest first."""
        ...

    def with_source(self, person_id: str, sha256: str) -> SequenceRow | None:
        """The sequence made from the same bytes; None where there is none."""
        ...

    def remove(self, sequence: SequenceRow) -> None:
        """Delete a sequence's row, and the rows that hang on it; its objects stay."""
        ...


class Motions(Protocol):
    """Motions of sequences."""

    def add(self, motion: MotionRow) -> None:
        """Store a sequence's motion, as the transaction commits."""
        ...

    def of_sequence(self, sequence_id: str) -> MotionRow | None:
        """The motion of a sequence; None where it has none yet."""
        ...


class Models(Protocol):
    """Trained models."""

    def add(self, model: ModelRow) -> None:
        """Store a new model, as the transaction commits."""
        ...

    def get(self, model_id: str) -> ModelRow:
        """The model of that id. Raises NotFound."""
        ...

    def of_person(self, person_id: str) -> list[ModelRow]:
        """The models of a person whose place no better one has taken, the oldest first."""
        ...

    def of_account(self, account: str) -> list[ModelRow]:
        """The same of all persons of `account`."""
        ...

    def supersede(self, model_id: str, better: ModelRow, now: datetime) -> list[str]:
        """Let `better` stand wherever the model of that id did.

        Returns the ids of the meetings in which it did: none where the model is gone.
        """
        ...

    def superseded_before(self, moment: datetime) -> list[ModelRow]:
        """Models whose place a better one took before `moment`, and which stand nowhere."""
        ...

    def remove(self, model: ModelRow) -> None:
        """Delete a model's row; its object stays."""
        ...


class Jobs(Protocol):
    """The queue, and what became of its jobs."""

    def add(self, job: JobRow) -> None:
        """Queue a new job, as the transaction commits."""
        ...

    def get(self, job_id: str) -> JobRow:
        """The job of that id. Raises NotFound."""
        ...

    def waiting(self, kinds: Collection[JobKind], now: datetime) -> dict[JobKind, int]:
        """How many queued jobs of each of `kinds` could be claimed now; none is not listed."""
        ...

    def claim(self, kinds: Collection[JobKind], worker: str, now: datetime) -> JobRow | None:
        """Take the oldest queued job of `kinds`, exclusively; None where there is none.

        A training waits until its clip is captured, and what found a disk full for its moment.
        """
        ...

    def with_expired_lease(self, renewed_before: datetime) -> list[JobRow]:
        """Running jobs whose heartbeat is older than `renewed_before`, locked."""
        ...

    def write(self, job_id: str, attempt: int, values: dict[str, Any]) -> bool:
        """Update a job that `attempt` still runs; False where it does so no more."""
        ...

    def latest(self, sequence_id: str, kind: JobKind) -> JobRow | None:
        """The youngest job of that kind on a sequence; None where there was none."""
        ...

    def of_sequence(self, sequence_id: str) -> list[JobRow]:
        """All jobs on a sequence, in no particular order."""
        ...

    def preview(self, job_id: str) -> bytes | None:
        """What a running job shows, as PNG; None where it has shown nothing yet."""
        ...

    def count(self) -> dict[tuple[str, str], int]:
        """The number of jobs by kind and state."""
        ...


class AuditLog(Protocol):
    """Who did what, when."""

    def add(self, event: AuditEventRow) -> None:
        """Store an event, as the transaction commits."""
        ...

    def of_account(self, account: str) -> list[AuditEventRow]:
        """All events of `account`, the oldest first."""
        ...

    def forget(self, before: datetime) -> int:
        """Delete the events of before a moment; how many went."""
        ...


class References(Protocol):
    """Which objects of the store rows point at."""

    def of_owner(self, owner: str) -> set[str]:
        """sha256 of every object that a row of person `owner` names."""
        ...

    def owners(self, among: Iterable[str]) -> set[str]:
        """Those of `among` who are persons."""
        ...


class UnitOfWork(Protocol):
    """One transaction: all or nothing, and nothing unless `commit` is called."""

    people: People
    uploads: Uploads
    sequences: Sequences
    motions: Motions
    models: Models
    jobs: Jobs
    meetings: Meetings
    gateways: Gateways
    recordings: Recordings
    audit: AuditLog
    references: References

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def flush(self) -> None:
        """Send what is pending, so that its constraints speak now.

        What they refuse leaves the unit as Conflict.
        """
        ...

    def commit(self) -> None:
        """Make it so.

        What can't be made so leaves the unit as Conflict, StoreFull or DatabaseAway.
        """
        ...
