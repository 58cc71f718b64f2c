"""The repository of recordings on SQLAlchemy; see `db.meeting_repositories.Recordings`."""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime

from sqlalchemy import delete, select

from db.models import (
    PersonRow,
    RecordingChunkRow,
    RecordingExportRow,
    RecordingMemberRow,
    RecordingRow,
    RecordingState,
)
from db.sql_repository import SqlRepository


class SqlRecordings(SqlRepository):
    """Recordings of meetings."""

    def add(self, recording: RecordingRow) -> None:
        """See `Recordings.add`."""
        self._session.add(recording)

    def get(self, recording_id: str) -> RecordingRow:
        """See `Recordings.get`."""
        return self._get(RecordingRow, recording_id, "recording")

    def get_for_change(self, recording_id: str) -> RecordingRow:
        """See `Recordings.get_for_change`."""
        return self._get(RecordingRow, recording_id, "recording", locked=True)

    def of_meeting(self, meeting_id: str) -> list[RecordingRow]:
        """See `Recordings.of_meeting`."""
        query = select(RecordingRow).where(RecordingRow.meeting_id == meeting_id)
        return list(self._session.scalars(query.order_by(RecordingRow.asked_at.desc())))

    def of_account(self, account: str) -> list[RecordingRow]:
        """See `Recordings.of_account`."""
        agreed = select(RecordingMemberRow.recording_id).where(
            RecordingMemberRow.account == account, RecordingMemberRow.agreed
        )
        query = select(RecordingRow).where(
            (RecordingRow.account == account) | RecordingRow.id.in_(agreed)
        )
        return list(self._session.scalars(query.order_by(RecordingRow.asked_at.desc())))

    def under_way(self, meeting_id: str) -> RecordingRow | None:
        """See `Recordings.under_way`."""
        query = select(RecordingRow).where(
            RecordingRow.meeting_id == meeting_id, RecordingRow.state != RecordingState.ENDED
        )
        return self._session.scalars(query.limit(1)).first()

    def with_person(self, person_id: str) -> list[str]:
        """See `Recordings.with_person`."""
        query = select(RecordingChunkRow.recording_id).where(
            RecordingChunkRow.person_id == person_id
        )
        return list(self._session.scalars(query.distinct()))

    def people(self, recording_id: str) -> list[PersonRow]:
        """See `Recordings.people`."""
        inside = select(RecordingChunkRow.person_id).where(
            RecordingChunkRow.recording_id == recording_id
        )
        return list(self._session.scalars(select(PersonRow).where(PersonRow.id.in_(inside))))

    def add_chunk(self, chunk: RecordingChunkRow) -> None:
        """See `Recordings.add_chunk`."""
        self._session.add(chunk)

    def chunks(self, recording_id: str, track: str | None = None) -> list[RecordingChunkRow]:
        """See `Recordings.chunks`."""
        query = select(RecordingChunkRow).where(RecordingChunkRow.recording_id == recording_id)
        if track is not None:
            query = query.where(RecordingChunkRow.track == track)
        ordered = query.order_by(RecordingChunkRow.track, RecordingChunkRow.number)
        return list(self._session.scalars(ordered))

    def drop_chunks(
        self, recording_id: str, account: str, participant_id: str | None = None
    ) -> list[RecordingChunkRow]:
        """See `Recordings.drop_chunks`."""
        theirs = [one for one in self.chunks(recording_id) if one.account == account]
        if participant_id is not None:
            theirs = [one for one in theirs if one.track.endswith(f":{participant_id}")]
        for chunk in theirs:
            self._session.delete(chunk)
        return theirs

    def add_export(self, export: RecordingExportRow) -> None:
        """See `Recordings.add_export`."""
        self._session.add(export)

    def exports(self, recording_ids: Collection[str]) -> list[RecordingExportRow]:
        """See `Recordings.exports`."""
        named = RecordingExportRow.recording_id.in_(recording_ids)
        return list(self._session.scalars(select(RecordingExportRow).where(named)))

    def drop_exports(self, recording_ids: Collection[str]) -> list[RecordingExportRow]:
        """See `Recordings.drop_exports`."""
        found = self.exports(recording_ids)
        named = RecordingExportRow.recording_id.in_(recording_ids)
        self._session.execute(delete(RecordingExportRow).where(named))
        return found

    def ended_before(self, moment: datetime) -> list[RecordingRow]:
        """See `Recordings.ended_before`."""
        query = select(RecordingRow).where(
            RecordingRow.state == RecordingState.ENDED, RecordingRow.ended_at < moment
        )
        return list(self._session.scalars(query.order_by(RecordingRow.ended_at)))

    def remove(self, recording: RecordingRow) -> list[tuple[str, str]]:
        """See `Recordings.remove`."""
        gone = [(one.owner, one.sha256) for one in self.chunks(recording.id)]
        gone += [(one.person_id, one.sha256) for one in self.drop_exports([recording.id])]
        self._session.delete(recording)
        return gone
