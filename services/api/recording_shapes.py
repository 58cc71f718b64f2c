"""What travels as JSON of recordings."""

from __future__ import annotations

from datetime import datetime

from pydantic import BaseModel, Field

from db.models import RecordingRow, RecordingState
from services.api.shapes import Body


class RecordedMember(BaseModel):
    """Somebody who agreed to be recorded."""

    participant_id: str
    name: str
    performer_id: str | None = Field(description="Who stood for them.")


class RecordedTrack(BaseModel):
    """What one moved, said or wrote."""

    name: str = Field(description="`room`, `motion:ID`, `voice:ID` or `chat:ID`.")
    bytes: int = Field(description="As kept; more when fetched.")
    url: str


class Recording(BaseModel):
    """A meeting that was, or is being, recorded."""

    id: str
    meeting_id: str
    name: str
    state: RecordingState
    asked_at: datetime
    ended_at: datetime | None
    why_ended: str | None
    duration_s: float
    bytes: int
    mine: bool = Field(description="Whether the token's account asked for it, and may delete it.")
    members: list[RecordedMember]

    @classmethod
    def of(cls, row: RecordingRow, account: str) -> Recording:
        return cls(
            id=row.id,
            meeting_id=row.meeting_id,
            name=row.name,
            state=row.state,
            asked_at=row.asked_at,
            ended_at=row.ended_at,
            why_ended=row.why_ended,
            duration_s=row.duration_ms / 1000.0,
            bytes=row.bytes,
            mine=row.account == account,
            members=[
                RecordedMember(
                    participant_id=one.participant_id, name=one.name, performer_id=one.performer_id
                )
                for one in row.members
                if one.agreed
            ],
        )


class RecordedVideo(BaseModel):
    """A video that was made of a recording."""

    job_id: str
    bytes: int
    url: str


class RecordingInFull(Recording):
    """A recording with what it holds."""

    tracks: list[RecordedTrack]
    videos: list[RecordedVideo]


class Recordings(BaseModel):
    """A list of recordings."""

    items: list[Recording]


class CameraStop(Body):
    """Where the camera is at a moment; between stops it moves evenly."""

    at_s: float = Field(ge=0.0, allow_inf_nan=False)
    position: tuple[float, float, float] = Field(description="Room, m.")
    target: tuple[float, float, float] = Field(description="What it looks at, m.")


class NewVideo(Body):
    """How a recording is to be filmed."""

    path: list[CameraStop] = Field(
        default_factory=list, max_length=200, description="Empty: once round everybody."
    )
    width: int = Field(default=1280, ge=64, le=1920, multiple_of=16)
    height: int = Field(default=720, ge=64, le=1088, multiple_of=16)
    fov_deg: float = Field(default=35.0, gt=1.0, lt=170.0, description="Vertical field of view.")


class RemovedFromRecording(BaseModel):
    """What was taken out of a recording."""

    chunks: int
    videos: int
