"""Tables of recordings: what was moved and said in a meeting, by whom, and who agreed to it.

What a person moved and said hangs on `person.id` as everywhere (db.models), and its bytes lie under
that person in the store, so that erasing somebody takes them out of every recording.
"""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum

from sqlalchemy import JSON, ForeignKey, String
from sqlalchemy.orm import Mapped, mapped_column, relationship

from db.base import Base, Id, Sha256, enum_column, new_id


class RecordingState(StrEnum):
    """How far a recording has come."""

    ASKING = "asking"
    """Somebody present has not agreed yet: nothing is kept meanwhile."""
    RUNNING = "running"
    ENDED = "ended"


class RecordingRow(Base):
    """A meeting as it was, or is being, recorded."""

    __tablename__ = "recording"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    meeting_id: Mapped[str] = mapped_column(
        ForeignKey("meeting.id", ondelete="CASCADE"), index=True
    )
    account: Mapped[str] = mapped_column(String(120), index=True)
    """Of the host who asked for it."""
    name: Mapped[str] = mapped_column(String(120))
    state: Mapped[RecordingState] = mapped_column(enum_column(RecordingState))
    asked_at: Mapped[datetime]
    ended_at: Mapped[datetime | None]
    why_ended: Mapped[str | None] = mapped_column(String(200))
    duration_ms: Mapped[int] = mapped_column(default=0)
    """Of what is kept; times in it leave out the pauses."""
    bytes: Mapped[int] = mapped_column(default=0)
    members: Mapped[list[RecordingMemberRow]] = relationship(
        lazy="selectin", cascade="all, delete-orphan", passive_deletes=True
    )


class RecordingMemberRow(Base):
    """Somebody who was there while it was recorded, and whether they agreed."""

    __tablename__ = "recording_member"

    recording_id: Mapped[str] = mapped_column(
        ForeignKey("recording.id", ondelete="CASCADE"), primary_key=True
    )
    participant_id: Mapped[str] = mapped_column(Id, primary_key=True)
    account: Mapped[str] = mapped_column(String(120), index=True)
    name: Mapped[str] = mapped_column(String(120))
    agreed: Mapped[bool]
    performer_id: Mapped[str | None] = mapped_column(Id)
    """Who stood for them."""
    person_id: Mapped[str | None] = mapped_column(
        ForeignKey("person.id", ondelete="CASCADE"), index=True
    )
    """Of that performer."""


class RecordingChunkRow(Base):
    """Some seconds of one track; see services.recording.chunks."""

    __tablename__ = "recording_chunk"

    recording_id: Mapped[str] = mapped_column(
        ForeignKey("recording.id", ondelete="CASCADE"), primary_key=True
    )
    track: Mapped[str] = mapped_column(String(80), primary_key=True)
    """`room`, `motion:PERFORMER`, `voice:PARTICIPANT` or `chat:PARTICIPANT`."""
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    person_id: Mapped[str | None] = mapped_column(
        ForeignKey("person.id", ondelete="CASCADE"), index=True
    )
    """Whose it is, where they have a person; the room is nobody's."""
    account: Mapped[str] = mapped_column(String(120))
    owner: Mapped[str] = mapped_column(Id, index=True)
    """Under whom the bytes lie: that person, or the recording."""
    bytes: Mapped[int]
    sha256: Mapped[str] = mapped_column(Sha256)


class RecordingExportRow(Base):
    """A video made of a recording; it goes with any person who is seen in it."""

    __tablename__ = "recording_export"

    recording_id: Mapped[str] = mapped_column(
        ForeignKey("recording.id", ondelete="CASCADE"), primary_key=True
    )
    job_id: Mapped[str] = mapped_column(Id, primary_key=True)
    person_id: Mapped[str] = mapped_column(ForeignKey("person.id", ondelete="CASCADE"), index=True)
    """A person of whoever asked for it; the bytes lie under them."""
    bytes: Mapped[int]
    sha256: Mapped[str] = mapped_column(Sha256, info={"object": True})
    shows: Mapped[list[str] | None] = mapped_column(JSON(none_as_null=True))
    """Ids of the people who are seen or heard in it; None: whoever was in the recording."""
