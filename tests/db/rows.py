"""Rows to test with."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from db.models import (
    AuditEventRow,
    BanRow,
    JobKind,
    JobRow,
    JobState,
    MeetingRow,
    MessageKind,
    MessageRow,
    ModelFileRow,
    ModelRow,
    MotionRow,
    PanoramaRow,
    ParticipantRow,
    PerformerRow,
    PersonRow,
    Purpose,
    RecordingChunkRow,
    RecordingExportRow,
    RecordingMemberRow,
    RecordingRow,
    RecordingState,
    Role,
    SequenceKind,
    SequenceRow,
    SequenceState,
    UploadChunkRow,
    UploadRow,
    new_id,
)
from db.objects import Objects
from db.unit_of_work import Database

NOW = datetime(2026, 1, 1, 12, 0, tzinfo=UTC)


def person(name: str = "Ada", account: str = "house") -> PersonRow:
    return PersonRow(id=new_id(), account=account, name=name, created_at=NOW)


def sequence(person_id: str, source_sha256: str = "a" * 64) -> SequenceRow:
    return SequenceRow(
        id=new_id(),
        person_id=person_id,
        kind=SequenceKind.VIDEO,
        state=SequenceState.UPLOADED,
        created_at=NOW,
        source_name="clip.mp4",
        source_sha256=source_sha256,
    )


def job(person_id: str, kind: JobKind = JobKind.TRAIN, created_at: datetime = NOW) -> JobRow:
    return JobRow(
        id=new_id(),
        person_id=person_id,
        kind=kind,
        state=JobState.QUEUED,
        params={},
        created_at=created_at,
    )


def full_life(database: Database, objects: Objects, name: str = "Ada") -> str:
    """A person with a row in every table but that of gateways, a meeting with somebody in it, and
    the objects that those name; their id."""
    someone = person(name)
    stored = [objects.put(someone.id, [f"{name} {i}".encode()]).sha256 for i in range(10)]
    source, packed, thumbnail, motion, weights, chunk, checkpoint, moved, video, frames = stored
    someone.height_m, someone.consent_until = 1.8, NOW + timedelta(days=9)
    someone.consent_purposes = [Purpose.MEETINGS.value, Purpose.LEARNING.value]
    clip = sequence(someone.id, source)
    clip.packed_sha256, clip.thumbnail_sha256 = packed, thumbnail
    model = ModelRow(
        id=new_id(),
        person_id=someone.id,
        sequence_id=clip.id,
        preset="splats",
        created_at=NOW,
        data_hash="d",
        metrics={"psnr": 33.0},
    )
    model.files = [
        ModelFileRow(name="model.safetensors", person_id=someone.id, bytes=5, sha256=weights)
    ]
    upload = UploadRow(
        person_id=someone.id, filename="b.mp4", size=9, sha256="b" * 64, created_at=NOW
    )
    upload.chunks = [UploadChunkRow(start=0, person_id=someone.id, bytes=5, sha256=chunk)]
    training = job(someone.id)
    training.sequence_id, training.checkpoint_sha256 = clip.id, checkpoint
    meeting = MeetingRow(id=new_id(), account="house", name="Monday", created_at=NOW)
    with database.unit_of_work() as unit:
        unit.people.add(someone)
        unit.flush()
        unit.sequences.add(clip)
        kept = sequence(someone.id, frames)
        kept.kind, kept.clip_id = SequenceKind.LIVE, clip.id
        unit.sequences.add(kept)
        unit.uploads.add(upload)
        unit.flush()
        unit.models.add(model)
        unit.motions.add(
            MotionRow(
                person_id=someone.id, sequence_id=clip.id, frames=3, duration_s=0.1, sha256=motion
            )
        )
        unit.jobs.add(training)
        unit.flush()
        meeting.performers = [
            PerformerRow(
                person_id=someone.id,
                model_id=model.id,
                name=name,
                place=0,
                front_yaw_rad=0.0,
                eye_height_m=1.6,
            )
        ]
        seat = ParticipantRow(
            id=new_id(),
            account="house",
            display_name=name,
            seat=1,
            joined_at=NOW,
            seen_at=NOW,
            heard_at=NOW,
            role=Role.HOST,
        )
        meeting.participants, meeting.presenter_id = [seat], seat.id
        meeting.bans = [BanRow(account="elsewhere", at=NOW)]
        unit.meetings.add(meeting)
        unit.flush()
        unit.meetings.say(
            MessageRow(
                meeting_id=meeting.id,
                kind=MessageKind.CHAT,
                participant_id=seat.id,
                name=name,
                text="Hello",
                at=NOW,
            )
        )
        unit.meetings.set_panorama(
            PanoramaRow(meeting_id=meeting.id, name="brought", picture=b"a picture", light={})
        )
        recording = RecordingRow(
            id=new_id(),
            meeting_id=meeting.id,
            account="house",
            name="Monday",
            state=RecordingState.ENDED,
            asked_at=NOW,
            ended_at=NOW,
        )
        recording.members = [
            RecordingMemberRow(
                participant_id=new_id(),
                account="house",
                name=name,
                agreed=True,
                person_id=someone.id,
            )
        ]
        unit.recordings.add(recording)
        unit.flush()
        unit.recordings.add_chunk(
            RecordingChunkRow(
                recording_id=recording.id,
                track="motion:x",
                number=0,
                person_id=someone.id,
                account="house",
                owner=someone.id,
                bytes=5,
                sha256=moved,
            )
        )
        unit.recordings.add_export(
            RecordingExportRow(
                recording_id=recording.id,
                job_id=new_id(),
                person_id=someone.id,
                bytes=5,
                sha256=video,
            )
        )
        unit.audit.add(
            AuditEventRow(
                person_id=someone.id, at=NOW, account="house", action="person.created", details={}
            )
        )
        unit.commit()
    return someone.id
