"""What services ask of the database, aggregate by aggregate. `db.sql` answers.

`get` raises NotFound; everything else that finds nothing returns None or an empty list. Nothing
here commits: that is the unit of work's.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from datetime import datetime
from types import TracebackType
from typing import Any, Protocol, Self

from db.models import (
    AuditEventRow,
    JobKind,
    JobRow,
    MeetingRow,
    MessageKind,
    MessageRow,
    ModelRow,
    MotionRow,
    PanoramaRow,
    PersonRow,
    RecordingChunkRow,
    RecordingExportRow,
    RecordingRow,
    SequenceRow,
    UploadRow,
)


class People(Protocol):
    """Persons."""

    def add(self, person: PersonRow) -> None: ...

    def get(self, person_id: str) -> PersonRow: ...

    def of_account(self, account: str) -> list[PersonRow]:
        """All persons of `account`, the oldest first."""
        ...

    def erase(self, person_id: str) -> dict[str, int]:
        """Delete every row of a person; says how many went, by table."""
        ...

    def count_rows(self, person_id: str) -> int:
        """How many rows, in whatever table, still belong to a person."""
        ...


class Uploads(Protocol):
    """Resumable uploads under way."""

    def add(self, upload: UploadRow) -> None: ...

    def get(self, upload_id: str) -> UploadRow: ...

    def with_content(self, person_id: str, sha256: str) -> UploadRow | None:
        """The upload under way of the same bytes, to go on with."""
        ...

    def remove(self, upload: UploadRow) -> None: ...

    def started_before(self, moment: datetime) -> list[UploadRow]: ...


class Sequences(Protocol):
    """Clips."""

    def add(self, sequence: SequenceRow) -> None: ...

    def get(self, sequence_id: str) -> SequenceRow: ...

    def of_person(self, person_id: str) -> list[SequenceRow]: ...

    def with_source(self, person_id: str, sha256: str) -> SequenceRow | None:
        """The sequence made from the same bytes."""
        ...

    def remove(self, sequence: SequenceRow) -> None: ...


class Motions(Protocol):
    """Motions of sequences."""

    def add(self, motion: MotionRow) -> None: ...

    def of_sequence(self, sequence_id: str) -> MotionRow | None: ...


class Models(Protocol):
    """Trained models."""

    def add(self, model: ModelRow) -> None: ...

    def get(self, model_id: str) -> ModelRow: ...

    def of_person(self, person_id: str) -> list[ModelRow]:
        """The models of a person whose place no better one has taken; so `of_account`."""
        ...

    def of_account(self, account: str) -> list[ModelRow]: ...

    def supersede(self, model_id: str, better: ModelRow, now: datetime) -> list[str]:
        """Let `better` stand wherever the model of that id did; says in which meetings."""
        ...

    def superseded_before(self, moment: datetime) -> list[ModelRow]:
        """Models whose place a better one took before `moment`, and which stand nowhere."""
        ...

    def remove(self, model: ModelRow) -> None: ...


class Jobs(Protocol):
    """The queue, and what became of its jobs."""

    def add(self, job: JobRow) -> None: ...

    def get(self, job_id: str) -> JobRow: ...

    def claim(self, kinds: Collection[JobKind], worker: str, now: datetime) -> JobRow | None:
        """Take the oldest queued job, exclusively; None where there is none."""
        ...

    def with_expired_lease(self, renewed_before: datetime) -> list[JobRow]:
        """Running jobs whose heartbeat is older than `renewed_before`, locked."""
        ...

    def write(self, job_id: str, attempt: int, values: dict[str, Any]) -> bool:
        """Update a job that `attempt` still runs; False where it does so no more."""
        ...

    def latest(self, sequence_id: str, kind: JobKind) -> JobRow | None: ...

    def of_sequence(self, sequence_id: str) -> list[JobRow]: ...

    def preview(self, job_id: str) -> bytes | None: ...

    def count(self) -> dict[tuple[str, str], int]:
        """Number of jobs by kind and state."""
        ...


class Meetings(Protocol):
    """Meetings with their performers and participants."""

    def add(self, meeting: MeetingRow) -> None: ...

    def get(self, meeting_id: str) -> MeetingRow: ...

    def get_for_change(self, meeting_id: str) -> MeetingRow:
        """Locked, so that two who join don't get one seat."""
        ...

    def with_label(self, label: str) -> MeetingRow | None: ...

    def moved_by(self, sequence_id: str) -> list[str]:
        """Meetings in which somebody moves by the motion of a sequence."""
        ...

    def where_performs(self, person_id: str) -> list[str]:
        """Ids of the meetings in which a person stands, or moves somebody else."""
        ...

    def seen(self, participant_ids: Collection[str], now: datetime) -> set[str]:
        """Note a sign of life of participants; says which of them are still there."""
        ...

    def heard(self, moments: Mapping[str, datetime]) -> None:
        """Note when pages of participants last spoke, by the participant's id."""
        ...

    def drop_participants(
        self, participant_ids: Collection[str], *, unless_heard_since: datetime | None = None
    ) -> None:
        """Give seats back, save those whose page has spoken since; gone already is no error."""
        ...

    def panorama(self, meeting_id: str) -> PanoramaRow | None:
        """The place that the host brought along, without its picture."""
        ...

    def panorama_picture(self, meeting_id: str) -> bytes | None:
        """JPEG."""
        ...

    def set_panorama(self, panorama: PanoramaRow) -> None:
        """In place of the one that the meeting had."""
        ...

    def say(self, message: MessageRow) -> None:
        """Add a message to a meeting that is locked; numbers it."""
        ...

    def said_since(self, meeting_id: str, number: int) -> list[MessageRow]:
        """The messages after `number`, the oldest first; at most the newest few hundred."""
        ...

    def forget_said(self, meeting_id: str, kind: MessageKind, before: datetime) -> None:
        """Delete the messages of one kind that are older than `before`."""
        ...


class Recordings(Protocol):
    """Recordings of meetings."""

    def add(self, recording: RecordingRow) -> None: ...

    def get(self, recording_id: str) -> RecordingRow: ...

    def get_for_change(self, recording_id: str) -> RecordingRow:
        """The same, locked until the transaction ends."""
        ...

    def of_meeting(self, meeting_id: str) -> list[RecordingRow]:
        """The newest first."""
        ...

    def of_account(self, account: str) -> list[RecordingRow]:
        """Those that somebody asked for, or agreed to; the newest first."""
        ...

    def under_way(self, meeting_id: str) -> RecordingRow | None:
        """The one of a meeting that has not ended."""
        ...

    def with_person(self, person_id: str) -> list[str]:
        """Ids of those in which a person moves or speaks."""
        ...

    def add_chunk(self, chunk: RecordingChunkRow) -> None: ...

    def chunks(self, recording_id: str, track: str | None = None) -> list[RecordingChunkRow]:
        """By track and number."""
        ...

    def drop_chunks(self, recording_id: str, account: str) -> list[RecordingChunkRow]:
        """Take out what an account's owner moved and said; says what it was."""
        ...

    def add_export(self, export: RecordingExportRow) -> None: ...

    def exports(self, recording_ids: Collection[str]) -> list[RecordingExportRow]: ...

    def drop_exports(self, recording_ids: Collection[str]) -> list[RecordingExportRow]:
        """Delete videos that were made; says which."""
        ...

    def remove(self, recording: RecordingRow) -> None: ...


class AuditLog(Protocol):
    """Who did what, when."""

    def add(self, event: AuditEventRow) -> None: ...

    def of_account(self, account: str) -> list[AuditEventRow]: ...


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
        """Send what is pending, so that its constraints speak now."""
        ...

    def commit(self) -> None: ...
