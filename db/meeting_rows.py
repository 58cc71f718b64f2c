"""Tables of meetings: who stands in a room, who is there, what they said.

Rows of a person hang on `person.id` as everywhere (db.models).
"""

from __future__ import annotations

from datetime import datetime, timedelta
from enum import StrEnum
from typing import Any

from sqlalchemy import ForeignKey, LargeBinary, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column, relationship

from db.base import Base, Id, enum_column, new_id
from db.person_rows import PersonRow, Purpose


class Role(StrEnum):
    """What somebody may do in a meeting."""

    HOST = "host"
    """Lets people in, sends them out, ends it."""
    SPEAKER = "speaker"
    """Talks and writes."""
    VIEWER = "viewer"
    """Looks on, raises a hand, reacts."""


class Admission(StrEnum):
    """Whether somebody is let into a meeting; with a lobby, the host decides."""

    WAITING = "waiting"
    """In the lobby."""
    ADMITTED = "admitted"
    DENIED = "denied"
    REMOVED = "removed"
    """Sent out by the host; their account is banned from the meeting."""
    ENDED = "ended"
    """The meeting was ended for everybody."""


class MessageKind(StrEnum):
    """What was said."""

    CHAT = "chat"
    REACTION = "reaction"
    CAPTION = "caption"
    """What somebody spoke, in writing."""


class Connection(StrEnum):
    """How well somebody's network carries the meeting."""

    GOOD = "good"
    FAIR = "fair"
    POOR = "poor"


SEAT_LAPSES_S = 30.0
"""Silence after which a seat is free."""


class MeetingRow(Base):
    """A room with performers in it."""

    __tablename__ = "meeting"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    account: Mapped[str] = mapped_column(String(120), index=True)
    name: Mapped[str] = mapped_column(String(120))
    label: Mapped[str | None] = mapped_column(String(32), unique=True)
    """Set for a meeting that is found by name, such as the demo's."""
    created_at: Mapped[datetime]
    lobby: Mapped[bool] = mapped_column(default=False)
    """Whoever comes waits until the host lets them in."""
    sealed: Mapped[bool] = mapped_column(default=False)
    """Motion travels end-to-end encrypted, by a key that only its pages know."""
    invitation: Mapped[int] = mapped_column(default=0)
    """How often its invitation was renewed; at 0, its id is the invitation."""
    environment: Mapped[str] = mapped_column(String(32), default="studio")
    """Name of the place that it is held in; see services.environments."""
    presenter_id: Mapped[str | None] = mapped_column(Id)
    """The participant who may share a screen; it counts while they are there."""
    presenter_asks_id: Mapped[str | None] = mapped_column(Id)
    """The participant who asks to share in that one's place."""
    home_id: Mapped[str | None] = mapped_column(Id)
    """The gateway that its voices and pictures are on; it counts while that one's lease runs."""
    ended_at: Mapped[datetime | None]
    performers: Mapped[list[PerformerRow]] = relationship(
        order_by="PerformerRow.place",
        lazy="selectin",
        cascade="all, delete-orphan",
        passive_deletes=True,
    )
    participants: Mapped[list[ParticipantRow]] = relationship(
        order_by="ParticipantRow.seat",
        lazy="selectin",
        cascade="all, delete-orphan",
        passive_deletes=True,
    )
    bans: Mapped[list[BanRow]] = relationship(
        lazy="selectin", cascade="all, delete-orphan", passive_deletes=True
    )

    def shown_at(self, now: datetime) -> list[PerformerRow]:
        """The performers who may be shown at `now`: those whose person consents to it then and,
        where they were brought by somebody invited, is there themselves.

        The others keep their place, should the consent be given again, or their owner come back.
        """
        there = self.accounts_at(now)
        return [
            one
            for one in self.performers
            if one.person.consents_to(Purpose.MEETINGS, now)
            and (one.account in there or not one.brought)
        ]

    def accounts_at(self, now: datetime) -> set[str]:
        """Of those who take part at `now`, or came or were lost a moment ago; not of who only looks
        on, with a role or before joining."""
        lapsed = now - timedelta(seconds=SEAT_LAPSES_S)
        return {
            one.account
            for one in self.participants
            if one.admission is Admission.ADMITTED
            and one.role is not Role.VIEWER
            and (one.heard_at or one.joined_at) >= lapsed
        }


class BanRow(Base):
    """An account whose owner was sent out of a meeting, and may not come back to it."""

    __tablename__ = "meeting_ban"

    meeting_id: Mapped[str] = mapped_column(
        ForeignKey("meeting.id", ondelete="CASCADE"), primary_key=True
    )
    account: Mapped[str] = mapped_column(String(120), primary_key=True)
    at: Mapped[datetime]


class PerformerRow(Base):
    """A person's model standing in a meeting."""

    __tablename__ = "performer"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    meeting_id: Mapped[str] = mapped_column(
        ForeignKey("meeting.id", ondelete="CASCADE"), index=True
    )
    person_id: Mapped[str] = mapped_column(ForeignKey("person.id", ondelete="CASCADE"), index=True)
    model_id: Mapped[str] = mapped_column(ForeignKey("model.id", ondelete="CASCADE"), index=True)
    motion_sequence_id: Mapped[str | None] = mapped_column(
        ForeignKey("sequence.id", ondelete="SET NULL"), index=True
    )
    """Whose motion they move by; empty: their model's own."""
    name: Mapped[str] = mapped_column(String(120))
    brought: Mapped[bool] = mapped_column(default=False)
    """By somebody invited, with whom they go; others are there until they are taken out."""
    place: Mapped[int]
    """Number of their place in the room, from 0; see services.arrangement."""
    front_yaw_rad: Mapped[float]
    """Turn about +y after which they face +z, by the motion that they are shown in."""
    eye_height_m: Mapped[float]
    """Mean height of their eyes above the floor in that motion."""
    person: Mapped[PersonRow] = relationship(lazy="joined", viewonly=True)

    @property
    def account(self) -> str:
        """Whose person stands there."""
        return self.person.account


class ParticipantRow(Base):
    """Somebody who is in a meeting, waits to be let in, or only looks on."""

    __tablename__ = "participant"
    __table_args__ = (UniqueConstraint("meeting_id", "seat"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    meeting_id: Mapped[str] = mapped_column(
        ForeignKey("meeting.id", ondelete="CASCADE"), index=True
    )
    account: Mapped[str] = mapped_column(String(120), default="")
    """Who sits here, by their token; empty for seats that an older release gave."""
    display_name: Mapped[str] = mapped_column(String(120))
    seat: Mapped[int]
    joined_at: Mapped[datetime]
    seen_at: Mapped[datetime]
    """When their view or page last gave a sign of life; at first, when they joined."""
    role: Mapped[Role] = mapped_column(enum_column(Role), default=Role.SPEAKER)
    admission: Mapped[Admission] = mapped_column(enum_column(Admission), default=Admission.ADMITTED)
    heard_at: Mapped[datetime | None]
    """When their page last spoke on the control channel; empty: it has not come yet."""
    hand_at: Mapped[datetime | None]
    """Since when their hand is up."""
    microphone: Mapped[bool] = mapped_column(default=False)
    """Whether they are to be heard."""
    connection: Mapped[Connection | None] = mapped_column(enum_column(Connection))
    """As their page last said; empty: it has not yet."""


class MessageRow(Base):
    """What somebody said to all: numbered, so that whoever was away can ask for the rest."""

    __tablename__ = "meeting_message"

    meeting_id: Mapped[str] = mapped_column(
        ForeignKey("meeting.id", ondelete="CASCADE"), primary_key=True
    )
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    """From 1."""
    kind: Mapped[MessageKind] = mapped_column(enum_column(MessageKind))
    participant_id: Mapped[str] = mapped_column(Id)
    """Who said it; the seat may have been given back since."""
    name: Mapped[str] = mapped_column(String(120))
    text: Mapped[str] = mapped_column(String(2000))
    at: Mapped[datetime]


class PanoramaRow(Base):
    """The place that a meeting's host brought along; the newest alone."""

    __tablename__ = "meeting_panorama"

    meeting_id: Mapped[str] = mapped_column(
        ForeignKey("meeting.id", ondelete="CASCADE"), primary_key=True
    )
    name: Mapped[str] = mapped_column(String(32))
    """As `MeetingRow.environment` says it while the meeting is held there."""
    picture: Mapped[bytes] = mapped_column(LargeBinary, deferred=True)
    """Equirectangular JPEG, at most some hundreds of kilobytes."""
    light: Mapped[dict[str, Any]]
    """Fields of `scene.lighting.Lighting`."""
