"""The repository of meetings on SQLAlchemy; see `db.meeting_repositories.Meetings`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from datetime import datetime

from sqlalchemy import delete, func, select, update

from db.models import (
    MeetingRow,
    MessageKind,
    MessageRow,
    PanoramaRow,
    ParticipantRow,
    PerformerRow,
    SequenceRow,
)
from db.sql_repository import SqlRepository

_MOST_MESSAGES = 300
"""Of a meeting's messages handed out at once."""


class SqlMeetings(SqlRepository):
    """Meetings with their performers and participants."""

    def add(self, meeting: MeetingRow) -> None:
        """See `Meetings.add`."""
        self._session.add(meeting)

    def get(self, meeting_id: str) -> MeetingRow:
        """See `Meetings.get`."""
        return self._get(MeetingRow, meeting_id, "meeting")

    def get_for_change(self, meeting_id: str) -> MeetingRow:
        """See `Meetings.get_for_change`."""
        return self._get(MeetingRow, meeting_id, "meeting", locked=True)

    def with_label(self, label: str) -> MeetingRow | None:
        """See `Meetings.with_label`."""
        return self._session.scalars(
            select(MeetingRow).where(MeetingRow.label == label)
        ).one_or_none()

    def moved_by(self, sequence_id: str) -> list[str]:
        """See `Meetings.moved_by`."""
        query = select(PerformerRow.meeting_id)
        query = query.where(PerformerRow.motion_sequence_id == sequence_id)
        return list(self._session.scalars(query.distinct()))

    def where_performs(self, person_id: str) -> list[str]:
        """See `Meetings.where_performs`."""
        theirs = select(SequenceRow.id).where(SequenceRow.person_id == person_id)
        query = select(PerformerRow.meeting_id).where(
            (PerformerRow.person_id == person_id) | PerformerRow.motion_sequence_id.in_(theirs)
        )
        return list(self._session.scalars(query.distinct()))

    def seen(self, participant_ids: Collection[str], now: datetime) -> set[str]:
        """See `Meetings.seen`."""
        named = ParticipantRow.id.in_(participant_ids)
        self._session.execute(update(ParticipantRow).where(named).values(seen_at=now))
        return set(self._session.scalars(select(ParticipantRow.id).where(named)))

    def heard(self, moments: Mapping[str, datetime]) -> None:
        """See `Meetings.heard`."""
        for participant_id, at in moments.items():
            statement = update(ParticipantRow).where(ParticipantRow.id == participant_id)
            self._session.execute(statement.values(heard_at=at, seen_at=at))

    def drop_participants(
        self, participant_ids: Collection[str], *, unless_heard_since: datetime | None = None
    ) -> None:
        """See `Meetings.drop_participants`."""
        dropped = delete(ParticipantRow).where(ParticipantRow.id.in_(participant_ids))
        if unless_heard_since is not None:
            silent = ParticipantRow.heard_at.is_(None) | (
                ParticipantRow.heard_at < unless_heard_since
            )
            dropped = dropped.where(silent)
        self._session.execute(dropped)

    def panorama(self, meeting_id: str) -> PanoramaRow | None:
        """See `Meetings.panorama`."""
        return self._session.get(PanoramaRow, meeting_id)

    def panorama_picture(self, meeting_id: str) -> bytes | None:
        """See `Meetings.panorama_picture`."""
        query = select(PanoramaRow.picture).where(PanoramaRow.meeting_id == meeting_id)
        return self._session.scalar(query)

    def set_panorama(self, panorama: PanoramaRow) -> None:
        """See `Meetings.set_panorama`."""
        self._session.merge(panorama)

    def say(self, message: MessageRow) -> None:
        """See `Meetings.say`."""
        newest = select(func.max(MessageRow.number)).where(
            MessageRow.meeting_id == message.meeting_id
        )
        message.number = (self._session.scalar(newest) or 0) + 1
        self._session.add(message)

    def messages_after(self, meeting_id: str, number: int) -> list[MessageRow]:
        """See `Meetings.messages_after`."""
        query = (
            select(MessageRow)
            .where(MessageRow.meeting_id == meeting_id, MessageRow.number > number)
            .order_by(MessageRow.number.desc())
            .limit(_MOST_MESSAGES)
        )
        return list(self._session.scalars(query))[::-1]

    def forget_said(self, meeting_id: str, kind: MessageKind, before: datetime) -> None:
        """See `Meetings.forget_said`."""
        self._session.execute(
            delete(MessageRow).where(
                MessageRow.meeting_id == meeting_id,
                MessageRow.kind == kind,
                MessageRow.at < before,
            )
        )
