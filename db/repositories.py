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
    GatewayRow,
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

    def add(self, person: PersonRow) -> None:
        """Store a new person, as the transaction commits."""
        ...

    def get(self, person_id: str) -> PersonRow:
        """The person of that id. Raises NotFound."""
        ...

    def of_account(self, account: str) -> list[PersonRow]:
        """All persons of `account`, the oldest first."""
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


class Meetings(Protocol):
    """Meetings with their performers and participants."""

    def add(self, meeting: MeetingRow) -> None:
        """Store a new meeting, as the transaction commits."""
        ...

    def get(self, meeting_id: str) -> MeetingRow:
        """The meeting of that id. Raises NotFound."""
        ...

    def get_for_change(self, meeting_id: str) -> MeetingRow:
        """The same, locked, so that two who join don't get one seat. Raises NotFound."""
        ...

    def with_label(self, label: str) -> MeetingRow | None:
        """The meeting that is found by that name, such as the demo's; None where there is none."""
        ...

    def moved_by(self, sequence_id: str) -> list[str]:
        """Ids of the meetings in which somebody moves by the motion of a sequence."""
        ...

    def where_performs(self, person_id: str) -> list[str]:
        """Ids of the meetings in which a person stands, or moves somebody else."""
        ...

    def seen(self, participant_ids: Collection[str], now: datetime) -> set[str]:
        """Note a sign of life of participants at `now`; the ids of those who are still there."""
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
        """The place that the host brought along, without its picture; None where there is none."""
        ...

    def panorama_picture(self, meeting_id: str) -> bytes | None:
        """The picture of that place, as equirectangular JPEG; None where there is none."""
        ...

    def set_panorama(self, panorama: PanoramaRow) -> None:
        """Store a meeting's place, instead of the one that it had."""
        ...

    def say(self, message: MessageRow) -> None:
        """Add a message to a meeting that is locked, and number it, from 1."""
        ...

    def messages_after(self, meeting_id: str, number: int) -> list[MessageRow]:
        """The messages after `number`, the oldest first; at most the newest few hundred."""
        ...

    def forget_said(self, meeting_id: str, kind: MessageKind, before: datetime) -> None:
        """Delete the messages of one kind that are older than `before`."""
        ...


class Gateways(Protocol):
    """Gateways that have an address of their own."""

    def renew(self, gateway: GatewayRow) -> None:
        """Store a gateway's sign of life, its first one too, as the transaction commits."""
        ...

    def renewed_since(self, moment: datetime) -> list[GatewayRow]:
        """The gateways that gave a sign of life since `moment`, by id."""
        ...

    def forget(self, gateway_id: str) -> None:
        """Delete the row of a gateway that ends."""
        ...

    def forget_silent(self, since: datetime) -> None:
        """Delete the rows of gateways that gave no sign of life since then."""
        ...


class Recordings(Protocol):
    """Recordings of meetings."""

    def add(self, recording: RecordingRow) -> None:
        """Store a new recording, as the transaction commits."""
        ...

    def get(self, recording_id: str) -> RecordingRow:
        """The recording of that id. Raises NotFound."""
        ...

    def get_for_change(self, recording_id: str) -> RecordingRow:
        """The same, locked until the transaction ends. Raises NotFound."""
        ...

    def of_meeting(self, meeting_id: str) -> list[RecordingRow]:
        """The recordings of a meeting, the newest first."""
        ...

    def of_account(self, account: str) -> list[RecordingRow]:
        """The recordings that somebody asked for, or agreed to; the newest first."""
        ...

    def under_way(self, meeting_id: str) -> RecordingRow | None:
        """The recording of a meeting that has not ended; None where there is none."""
        ...

    def with_person(self, person_id: str) -> list[str]:
        """Ids of the recordings in which a person moves or speaks."""
        ...

    def people(self, recording_id: str) -> list[PersonRow]:
        """The people who move or speak in a recording, in no particular order."""
        ...

    def add_chunk(self, chunk: RecordingChunkRow) -> None:
        """Store what one track holds of some seconds; its bytes are in the store already."""
        ...

    def chunks(self, recording_id: str, track: str | None = None) -> list[RecordingChunkRow]:
        """The chunks of a recording, or of one of its tracks, by track and number."""
        ...

    def drop_chunks(
        self, recording_id: str, account: str, participant_id: str | None = None
    ) -> list[RecordingChunkRow]:
        """Take out what an account's owner moved and said, or of an account of many what one
        participant said; the rows that went."""
        ...

    def add_export(self, export: RecordingExportRow) -> None:
        """Store a video that was made of a recording; its bytes are in the store already."""
        ...

    def exports(self, recording_ids: Collection[str]) -> list[RecordingExportRow]:
        """The videos that were made of recordings, in no particular order."""
        ...

    def drop_exports(self, recording_ids: Collection[str]) -> list[RecordingExportRow]:
        """Delete videos that were made; the rows that went, whose objects stay."""
        ...

    def remove(self, recording: RecordingRow) -> None:
        """Delete a recording's row, and the rows that hang on it; its objects stay."""
        ...


class AuditLog(Protocol):
    """Who did what, when."""

    def add(self, event: AuditEventRow) -> None:
        """Store an event, as the transaction commits."""
        ...

    def of_account(self, account: str) -> list[AuditEventRow]:
        """All events of `account`, the oldest first."""
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
