"""Tables. Ids are 32 hex digits, moments are UTC, bytes lie in the object store.

Every row of a person hangs on `person.id` by a foreign key that cascades, so that erasing a person
is one statement that no table can be forgotten in. A column that names an object of the store says
so in its `info`, from which the sweeper and the eraser learn what is in use.
"""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index, LargeBinary, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column, relationship

from db.base import Base as Base
from db.base import Id, Sha256, enum_column
from db.base import new_id as new_id
from db.gateway_rows import GatewayRow as GatewayRow
from db.meeting_rows import Admission as Admission
from db.meeting_rows import BanRow as BanRow
from db.meeting_rows import Connection as Connection
from db.meeting_rows import MeetingRow as MeetingRow
from db.meeting_rows import MessageKind as MessageKind
from db.meeting_rows import MessageRow as MessageRow
from db.meeting_rows import PanoramaRow as PanoramaRow
from db.meeting_rows import ParticipantRow as ParticipantRow
from db.meeting_rows import PerformerRow as PerformerRow
from db.meeting_rows import Role as Role
from db.person_rows import USUAL_PURPOSES as USUAL_PURPOSES
from db.person_rows import ConsentState as ConsentState
from db.person_rows import PersonRow as PersonRow
from db.person_rows import Purpose as Purpose
from db.recording_rows import RecordingChunkRow as RecordingChunkRow
from db.recording_rows import RecordingExportRow as RecordingExportRow
from db.recording_rows import RecordingMemberRow as RecordingMemberRow
from db.recording_rows import RecordingRow as RecordingRow
from db.recording_rows import RecordingState as RecordingState

OBJECT = {"object": True}
"""`Column.info` of columns that hold the sha256 of an object of the row's person."""


class SequenceKind(StrEnum):
    """What was uploaded."""

    VIDEO = "video"
    FRAMES = "frames"
    KEYPOINTS = "keypoints"
    LIVE = "live"
    """Not uploaded: pictures of live look that were kept."""


class SequenceState(StrEnum):
    """How far a sequence has come."""

    UPLOADED = "uploaded"
    CAPTURING = "capturing"
    READY = "ready"
    FORGOTTEN = "forgotten"
    """Its clip and frames went once a model was trained, as whoever enrolled wished."""


class JobKind(StrEnum):
    """What a job does."""

    CAPTURE = "capture"
    TRAIN = "train"
    EXPORT = "export"
    """Makes a video of a recording."""


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
    kind: Mapped[SequenceKind] = mapped_column(enum_column(SequenceKind))
    state: Mapped[SequenceState] = mapped_column(enum_column(SequenceState))
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
    model_only: Mapped[bool] = mapped_column(default=False)
    """Whether the clip, its frames and its thumbnail go once a model was trained from them."""
    clip_id: Mapped[str | None] = mapped_column(Id)
    """Of pictures of live look: the sequence of their model, with which they are trained on."""


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
    superseded_at: Mapped[datetime | None]
    """When a better one took its place, or its clip was given up; it is kept a while for those who
    still look at it."""
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
    kind: Mapped[JobKind] = mapped_column(enum_column(JobKind))
    state: Mapped[JobState] = mapped_column(enum_column(JobState))
    params: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]
    sequence_id: Mapped[str | None] = mapped_column(
        ForeignKey("sequence.id", ondelete="SET NULL"), index=True
    )
    model_id: Mapped[str | None] = mapped_column(ForeignKey("model.id", ondelete="SET NULL"))
    """Of a training, the best there is so far: while its clip is captured, a first likeness."""
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
    not_before: Mapped[datetime | None]
    """When a job that waits for room on a full disk may be claimed."""
    full_disks: Mapped[int] = mapped_column(default=0)
    """How often it found a disk full."""
    worker: Mapped[str | None] = mapped_column(String(120))
    heartbeat_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]
    cancel_requested: Mapped[bool] = mapped_column(default=False)
    checkpoint_sha256: Mapped[str | None] = mapped_column(Sha256, info=OBJECT)
    traceparent: Mapped[str | None] = mapped_column(String(55))
    """Of the span in which it was asked for (W3C Trace Context); None where that is not traced."""


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
