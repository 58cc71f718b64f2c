"""Tables. Ids are 32 hex digits, moments are UTC, bytes lie in the object store.

Every row of a person hangs on `person.id` by a foreign key that cascades, so that erasing a person
is one statement that no table can be forgotten in. A column that names an object of the store says
so in its `info`, from which the sweeper and the eraser learn what is in use.
"""

from __future__ import annotations

import uuid
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, ClassVar

from sqlalchemy import (
    JSON,
    BigInteger,
    CheckConstraint,
    DateTime,
    Dialect,
    Enum,
    ForeignKey,
    Index,
    LargeBinary,
    MetaData,
    String,
    TypeDecorator,
    UniqueConstraint,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

OBJECT = {"object": True}
"""`Column.info` of columns that hold the sha256 of an object of the row's person."""


class UtcDateTime(TypeDecorator[datetime]):
    """A moment with its time zone, also on SQLite, which stores none."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"a stored moment must have a time zone; got {value!r}")
        return value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


def new_id() -> str:
    """A random id: 32 hex digits that can't be guessed."""
    return uuid.uuid4().hex


class Base(DeclarativeBase):
    """Root of the tables; names of constraints are fixed so that migrations can name them."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "ck": "ck_%(table_name)s_%(constraint_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map: ClassVar[dict[Any, Any]] = {
        datetime: UtcDateTime,
        int: BigInteger,
        dict[str, Any]: JSON(none_as_null=True),
    }


Id = String(32)
Sha256 = String(64)


def _words(kind: type[StrEnum]) -> Enum:
    """The members of `kind` by value, as text: a new member needs no migration."""
    return Enum(
        kind,
        native_enum=False,
        create_constraint=False,
        length=16,
        values_callable=lambda members: [member.value for member in members],
    )


class SequenceKind(StrEnum):
    """What was uploaded."""

    VIDEO = "video"
    FRAMES = "frames"
    KEYPOINTS = "keypoints"


class SequenceState(StrEnum):
    """How far a sequence has come."""

    UPLOADED = "uploaded"
    CAPTURING = "capturing"
    READY = "ready"


class JobKind(StrEnum):
    """What a job does."""

    CAPTURE = "capture"
    TRAIN = "train"


class JobState(StrEnum):
    """Where a job stands."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def final(self) -> bool:
        """Whether nothing more happens unless somebody resumes the job."""
        return self in (JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED)


class PersonRow(Base):
    """Somebody who is, or will be, met."""

    __tablename__ = "person"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    account: Mapped[str] = mapped_column(String(120), index=True)
    """Whose person this is: the subject of the token that made it."""
    name: Mapped[str] = mapped_column(String(120))
    created_at: Mapped[datetime]


class UploadRow(Base):
    """A resumable upload under way; its chunks are objects until the last one has come."""

    __tablename__ = "upload"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    person_id: Mapped[str] = mapped_column(ForeignKey("person.id", ondelete="CASCADE"), index=True)
    filename: Mapped[str] = mapped_column(String(255))
    size: Mapped[int]
    sha256: Mapped[str] = mapped_column(Sha256)
    created_at: Mapped[datetime]
    chunks: Mapped[list[UploadChunkRow]] = relationship(
        order_by="UploadChunkRow.start",
        lazy="selectin",
        cascade="all, delete-orphan",
        passive_deletes=True,
    )

    @property
    def offset(self) -> int:
        """How many bytes have come."""
        return self.chunks[-1].start + self.chunks[-1].bytes if self.chunks else 0


class UploadChunkRow(Base):
    """One piece of an upload. The key makes two writers of one offset collide."""

    __tablename__ = "upload_chunk"

    upload_id: Mapped[str] = mapped_column(
        ForeignKey("upload.id", ondelete="CASCADE"), primary_key=True
    )
    start: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    person_id: Mapped[str] = mapped_column(ForeignKey("person.id", ondelete="CASCADE"), index=True)
    bytes: Mapped[int]
    sha256: Mapped[str] = mapped_column(Sha256, info=OBJECT)


class SequenceRow(Base):
    """One clip of one person."""

    __tablename__ = "sequence"
    __table_args__ = (UniqueConstraint("person_id", "source_sha256"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    person_id: Mapped[str] = mapped_column(ForeignKey("person.id", ondelete="CASCADE"), index=True)
    kind: Mapped[SequenceKind] = mapped_column(_words(SequenceKind))
    state: Mapped[SequenceState] = mapped_column(_words(SequenceState))
    created_at: Mapped[datetime]
    source_name: Mapped[str] = mapped_column(String(255))
    source_sha256: Mapped[str] = mapped_column(Sha256, info=OBJECT)
    """The upload itself, as it came."""
    packed_sha256: Mapped[str | None] = mapped_column(Sha256, info=OBJECT)
    """The captured sequence folder, packed (tar)."""
    thumbnail_sha256: Mapped[str | None] = mapped_column(Sha256, info=OBJECT)
    frames: Mapped[int | None]
    frames_per_second: Mapped[float | None]
    duration_s: Mapped[float | None]
    quality: Mapped[dict[str, Any] | None]


class MotionRow(Base):
    """The motion of a sequence, on its own so that it can drive any model."""

    __tablename__ = "motion"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    person_id: Mapped[str] = mapped_column(ForeignKey("person.id", ondelete="CASCADE"), index=True)
    sequence_id: Mapped[str] = mapped_column(
        ForeignKey("sequence.id", ondelete="CASCADE"), unique=True
    )
    frames: Mapped[int]
    duration_s: Mapped[float]
    sha256: Mapped[str] = mapped_column(Sha256, info=OBJECT)
    """motion.npz"""


class ModelRow(Base):
    """A trained model."""

    __tablename__ = "model"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    person_id: Mapped[str] = mapped_column(ForeignKey("person.id", ondelete="CASCADE"), index=True)
    sequence_id: Mapped[str | None] = mapped_column(
        ForeignKey("sequence.id", ondelete="SET NULL"), index=True
    )
    preset: Mapped[str] = mapped_column(String(64))
    created_at: Mapped[datetime]
    data_hash: Mapped[str] = mapped_column(String(128))
    metrics: Mapped[dict[str, Any]]
    files: Mapped[list[ModelFileRow]] = relationship(
        order_by="ModelFileRow.name",
        lazy="selectin",
        cascade="all, delete-orphan",
        passive_deletes=True,
    )


class ModelFileRow(Base):
    """One file of a model: weights, or splats for a viewer."""

    __tablename__ = "model_file"

    model_id: Mapped[str] = mapped_column(
        ForeignKey("model.id", ondelete="CASCADE"), primary_key=True
    )
    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    person_id: Mapped[str] = mapped_column(ForeignKey("person.id", ondelete="CASCADE"), index=True)
    bytes: Mapped[int]
    sha256: Mapped[str] = mapped_column(Sha256, info=OBJECT)


class JobRow(Base):
    """Long work: who does it, how far it is, how it ended."""

    __tablename__ = "job"
    __table_args__ = (
        CheckConstraint("progress >= 0 AND progress <= 1", name="progress"),
        Index("ix_job_state_created_at", "state", "created_at"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    person_id: Mapped[str] = mapped_column(ForeignKey("person.id", ondelete="CASCADE"), index=True)
    kind: Mapped[JobKind] = mapped_column(_words(JobKind))
    state: Mapped[JobState] = mapped_column(_words(JobState))
    params: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]
    sequence_id: Mapped[str | None] = mapped_column(
        ForeignKey("sequence.id", ondelete="SET NULL"), index=True
    )
    model_id: Mapped[str | None] = mapped_column(ForeignKey("model.id", ondelete="SET NULL"))
    progress: Mapped[float] = mapped_column(default=0.0)
    message: Mapped[str] = mapped_column(String(500), default="")
    preview: Mapped[bytes | None] = mapped_column(LargeBinary, deferred=True)
    """PNG, at most some tens of kilobytes."""
    preview_version: Mapped[int] = mapped_column(default=0)
    """How many previews there have been; 0: none."""
    error: Mapped[dict[str, Any] | None]
    """A problem (RFC 9457) where the job failed."""
    attempt: Mapped[int] = mapped_column(default=0)
    """How often the job was claimed; only the latest attempt may write."""
    crashes: Mapped[int] = mapped_column(default=0)
    """How often its process died without a word."""
    worker: Mapped[str | None] = mapped_column(String(120))
    heartbeat_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]
    cancel_requested: Mapped[bool] = mapped_column(default=False)
    checkpoint_sha256: Mapped[str | None] = mapped_column(Sha256, info=OBJECT)


class MeetingRow(Base):
    """A room with performers in it."""

    __tablename__ = "meeting"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    account: Mapped[str] = mapped_column(String(120), index=True)
    name: Mapped[str] = mapped_column(String(120))
    label: Mapped[str | None] = mapped_column(String(32), unique=True)
    """Set for a meeting that is found by name, such as the demo's."""
    created_at: Mapped[datetime]
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
    place: Mapped[int]
    """Order of arrival, from 0."""
    x_m: Mapped[float]
    y_m: Mapped[float]
    z_m: Mapped[float]
    yaw_rad: Mapped[float]


class ParticipantRow(Base):
    """Somebody who looks on."""

    __tablename__ = "participant"
    __table_args__ = (UniqueConstraint("meeting_id", "seat"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    meeting_id: Mapped[str] = mapped_column(
        ForeignKey("meeting.id", ondelete="CASCADE"), index=True
    )
    display_name: Mapped[str] = mapped_column(String(120))
    seat: Mapped[int]
    joined_at: Mapped[datetime]
    seen_at: Mapped[datetime]
    """When their view last gave a sign of life; at first, when they joined."""


class AuditEventRow(Base):
    """Who did what, when. Events about a person go with the person."""

    __tablename__ = "audit_event"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    person_id: Mapped[str | None] = mapped_column(
        ForeignKey("person.id", ondelete="CASCADE"), index=True
    )
    at: Mapped[datetime]
    account: Mapped[str] = mapped_column(String(120))
    action: Mapped[str] = mapped_column(String(64))
    details: Mapped[dict[str, Any]]
