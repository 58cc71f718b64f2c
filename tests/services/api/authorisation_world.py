"""Two accounts with everything that an account can have, and callers in every role towards them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from enum import StrEnum
from pathlib import Path

from db.models import (
    Admission,
    BanRow,
    JobKind,
    JobRow,
    JobState,
    MeetingRow,
    PanoramaRow,
    ParticipantRow,
    RecordingChunkRow,
    RecordingExportRow,
    RecordingMemberRow,
    RecordingRow,
    RecordingState,
    Role,
    SequenceKind,
    SequenceRow,
    SequenceState,
    UploadRow,
    new_id,
)
from db.unit_of_work import SqlUnitOfWork
from services.auth import ALL_SCOPES
from services.bootstrap import DEMO_MODEL, import_model
from services.container import Services
from services.environments import brought_along
from services.meetings import create_meeting
from services.recording.chunks import Record, pack
from tests.services import seeds

DAY = timedelta(days=1)
ADA, CY, BO, DEE = "guest-ada", "guest-cy", "guest-bo", "guest-dee"


class Caller(StrEnum):
    """Who calls, as they are towards what is Ada's; nobody but Cy has to do with what is Cy's."""

    NONE = "none"
    GUEST = "guest"
    """Ada: it is hers."""
    OTHER = "other guest"
    VIEWER = "viewer"
    SPEAKER = "speaker"
    """Who has also agreed to be recorded."""
    HOST = "host"
    FORMER = "former host"
    """Ada's own seat, which handed the role over."""
    WAITING = "waiting"
    REMOVED = "removed"
    EXPIRED = "expired"
    """Ada's token, once it has ended."""
    ELSEWHERE = "member elsewhere"


@dataclass(frozen=True)
class Belongings:
    """Ids of what is one account's, by the names of the routes' parameters."""

    params: dict[str, str]

    def path(self, template: str) -> str:
        """A route's path with these ids."""
        return template.format_map(self.params)


@dataclass(frozen=True)
class World:
    """Who there is, and what they have."""

    ada: Belongings
    cy: Belongings
    tokens: dict[Caller, str]

    def headers(self, caller: Caller) -> dict[str, str]:
        """What a caller says of themselves."""
        token = self.tokens[caller]
        return {"Authorization": f"Bearer {token}"} if token else {}


def build(services: Services) -> World:
    """Make it all, on an empty database."""
    ada, cy = _belongings(services, ADA), _belongings(services, CY)
    tokens = dict.fromkeys(Caller, "")
    for caller, account, lifetime in (
        (Caller.GUEST, ADA, DAY),
        (Caller.OTHER, BO, DAY),
        (Caller.EXPIRED, ADA, -DAY),
    ):
        tokens[caller], _ = services.tokens.issue(account, ALL_SCOPES, lifetime)
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get(ada.params["meeting_id"])
        meeting.lobby = True
        for caller, account, role, admission in (
            (Caller.VIEWER, "guest-vi", Role.VIEWER, Admission.ADMITTED),
            (Caller.SPEAKER, "guest-sp", Role.SPEAKER, Admission.ADMITTED),
            (Caller.HOST, "guest-ho", Role.HOST, Admission.ADMITTED),
            (Caller.FORMER, ADA, Role.SPEAKER, Admission.ADMITTED),
            (Caller.WAITING, "guest-wa", Role.SPEAKER, Admission.WAITING),
            (Caller.REMOVED, "guest-re", Role.SPEAKER, Admission.REMOVED),
        ):
            tokens[caller] = _seat(services, meeting, account, role, admission)
        meeting.bans.append(BanRow(account="guest-re", at=services.clock()))
        speaker = next(one for one in meeting.participants if one.account == "guest-sp")
        recording = unit.recordings.get(ada.params["recording_id"])
        recording.members.append(
            RecordingMemberRow(
                participant_id=speaker.id, account="guest-sp", name="Speaker", agreed=True
            )
        )
        elsewhere = create_meeting(services, unit, DEE, "Elsewhere", [])
        tokens[Caller.ELSEWHERE] = _seat(services, elsewhere, DEE, Role.HOST, Admission.ADMITTED)
        unit.commit()
    return World(ada, cy, tokens)


def _seat(
    services: Services, meeting: MeetingRow, account: str, role: Role, admission: Admission
) -> str:
    now = services.clock()
    row = ParticipantRow(
        id=new_id(),
        account=account,
        display_name=role.value,
        seat=len(meeting.participants) + 1,
        joined_at=now,
        seen_at=now,
        heard_at=now,
        role=role,
        admission=admission,
    )
    meeting.participants.append(row)
    claimed = Role.HOST if account in (ADA, DEE) else Role.SPEAKER
    claimed = Role.VIEWER if role is Role.VIEWER else claimed
    join = frozenset({"join"})
    token, _ = services.tokens.issue(account, join, DAY, meeting.id, row.id, claimed)
    return token


def _belongings(services: Services, account: str) -> Belongings:
    model = import_model(services, Path(DEMO_MODEL), account, account.title())
    person_id, now = model.person_id, services.clock()
    stored = services.objects.put(person_id, [f"bytes of {account}".encode()])
    sequence = SequenceRow(
        id=new_id(),
        person_id=person_id,
        kind=SequenceKind.VIDEO,
        state=SequenceState.READY,
        created_at=now,
        source_name="clip.mp4",
        source_sha256=stored.sha256,
        packed_sha256=stored.sha256,
        thumbnail_sha256=stored.sha256,
    )
    job = JobRow(
        id=new_id(),
        person_id=person_id,
        kind=JobKind.TRAIN,
        state=JobState.FAILED,
        params={},
        created_at=now,
        sequence_id=sequence.id,
        preview=seeds.picture(),
        preview_version=1,
    )
    waiting = JobRow(
        id=new_id(),
        person_id=person_id,
        kind=JobKind.EXPORT,
        state=JobState.QUEUED,
        params={},
        created_at=now,
    )
    # what DELETE of a sequence takes, which must have no job
    spare = SequenceRow(
        id=new_id(),
        person_id=person_id,
        kind=SequenceKind.VIDEO,
        state=SequenceState.READY,
        created_at=now,
        source_name="spare.mp4",
        source_sha256="1" * 64,
    )
    upload = UploadRow(
        id=new_id(), person_id=person_id, filename="a.mp4", size=9, sha256="2" * 64, created_at=now
    )
    with services.unit_of_work() as unit:
        unit.sequences.add(sequence)
        unit.sequences.add(spare)
        unit.uploads.add(upload)
        unit.flush()
        unit.jobs.add(job)
        unit.jobs.add(waiting)
        meeting = create_meeting(services, unit, account, "Monday", [unit.models.get(model.id)])
        unit.flush()
        unit.meetings.set_panorama(panorama(meeting.id))
        recording, video = _recording(services, unit, meeting, person_id, account, stored.sha256)
        unit.commit()
    return Belongings(
        {
            "person_id": person_id,
            "sequence_id": sequence.id,
            "spare_id": spare.id,
            "upload_id": upload.id,
            "job_id": job.id,
            "waiting_id": waiting.id,
            "model_id": model.id,
            "meeting_id": meeting.id,
            "performer_id": meeting.performers[0].id,
            "recording_id": recording.id,
            "track": f"motion:{meeting.performers[0].id}",
            "participant_id": recording.members[0].participant_id,
            "video_id": video,
            "session_id": "none",
        }
    )


def panorama(meeting_id: str) -> PanoramaRow:
    """A place that a host brought along."""
    import cv2
    import numpy as np

    pixels = np.full((64, 128, 3), 90, np.uint8)
    return brought_along(meeting_id, cv2.imencode(".png", pixels)[1].tobytes())


def _recording(
    services: Services,
    unit: SqlUnitOfWork,
    meeting: MeetingRow,
    person_id: str,
    account: str,
    sha256: str,
) -> tuple[RecordingRow, str]:
    participant_id, performer = new_id(), meeting.performers[0]
    recording = RecordingRow(
        id=new_id(),
        meeting_id=meeting.id,
        account=account,
        name="Monday",
        state=RecordingState.ENDED,
        asked_at=services.clock(),
        duration_ms=20,
        bytes=100,
    )
    recording.members = [
        RecordingMemberRow(
            participant_id=participant_id,
            account=account,
            name=account,
            agreed=True,
            performer_id=performer.id,
            person_id=person_id,
        )
    ]
    unit.recordings.add(recording)
    unit.flush()
    chunk = services.objects.put(person_id, [pack([Record(0, b"packet")])])
    for track in (f"motion:{performer.id}", f"voice:{participant_id}"):
        unit.recordings.add_chunk(
            RecordingChunkRow(
                recording_id=recording.id,
                track=track,
                number=0,
                person_id=person_id,
                account=account,
                owner=person_id,
                bytes=chunk.bytes,
                sha256=chunk.sha256,
            )
        )
    video = RecordingExportRow(
        recording_id=recording.id, job_id=new_id(), person_id=person_id, bytes=9, sha256=sha256
    )
    unit.recordings.add_export(video)
    return recording, video.job_id
