"""Meetings: who stands where, and how others are asked in."""

from __future__ import annotations

from datetime import timedelta
from urllib.parse import quote

from db.errors import NotFound
from db.models import MeetingRow, ModelRow, PerformerRow, Role, new_id
from db.repositories import UnitOfWork
from scene.motion import Motion
from services.auth import INVITED
from services.container import Services
from services.errors import MeetingFull
from services.live.room import circle_layout, facing_yaw
from services.motions import motion_of

DEMO = "demo"
"""Label of the meeting that the demo shows."""
MOST_PERFORMERS = 12
_LINK_LIFETIME = timedelta(days=7)


def create_meeting(
    services: Services,
    unit: UnitOfWork,
    account: str,
    name: str,
    models: list[ModelRow],
    label: str | None = None,
    lobby: bool = False,
) -> MeetingRow:
    """A new meeting with `models` standing in it; with `lobby`, who comes waits to be let in."""
    meeting = MeetingRow(
        id=new_id(),
        account=account,
        name=name,
        label=label,
        created_at=services.clock(),
        lobby=lobby,
    )
    unit.meetings.add(meeting)
    unit.flush()
    for model in models:
        _add(unit, meeting, model, None)
    arrange(services, unit, meeting)
    return meeting


def add_performer(
    services: Services,
    unit: UnitOfWork,
    meeting: MeetingRow,
    model: ModelRow,
    motion_sequence_id: str | None = None,
) -> PerformerRow:
    """One more performer, who moves by a sequence's motion or by the model's own.

    Everybody moves up. Raises MeetingFull, or NotCaptured where the sequence has no motion.
    """
    if len(meeting.performers) >= MOST_PERFORMERS:
        raise MeetingFull(
            f"a meeting must have at most {MOST_PERFORMERS} performers; got one more; "
            "remove somebody first",
        )
    performer = _add(unit, meeting, model, motion_sequence_id)
    arrange(services, unit, meeting)
    return performer


def remove_performer(
    services: Services, unit: UnitOfWork, meeting: MeetingRow, performer_id: str
) -> None:
    """One performer less. Raises NotFound for one who is not there."""
    found = [one for one in meeting.performers if one.id == performer_id]
    if not found:
        raise NotFound(
            f"id must be that of a performer of this meeting; got {performer_id!r}; "
            "read the meeting to see who is there",
        )
    meeting.performers.remove(found[0])
    arrange(services, unit, meeting)


def arrange(services: Services, unit: UnitOfWork, meeting: MeetingRow) -> None:
    """Place everybody on a circle, facing its middle."""
    count = len(meeting.performers)
    if count == 0:
        return
    for index, (performer, (place, yaw_rad)) in enumerate(
        zip(meeting.performers, circle_layout(count), strict=True)
    ):
        motion = performed_motion(services, unit, performer)
        performer.place = index
        performer.x_m, performer.y_m, performer.z_m = place
        performer.yaw_rad = yaw_rad + facing_yaw(motion)


def performed_motion(services: Services, unit: UnitOfWork, performer: PerformerRow) -> Motion:
    """How a performer moves: as the sequence that was lent to them, else as they were filmed."""
    if performer.motion_sequence_id is not None:
        return motion_of(services, unit, performer.motion_sequence_id)
    return services.models.load_row(unit.models.get(performer.model_id)).motion


def join_url(services: Services, meeting: MeetingRow) -> str:
    """The link to send. Where access is not open, it carries a token for this meeting."""
    settings = services.settings
    url = f"{settings.server.public_url.rstrip('/')}/?meeting={quote(meeting.id)}"
    if settings.security.open_access:
        return url
    token, _ = services.tokens.issue(
        INVITED, frozenset({"join"}), _LINK_LIFETIME, meeting_id=meeting.id
    )
    return f"{url}#token={token}"


def host_token(services: Services, meeting: MeetingRow) -> str:
    """What whoever opened a meeting joins it with, to be its host."""
    token, _ = services.tokens.issue(
        meeting.account,
        frozenset({"join"}),
        _LINK_LIFETIME,
        meeting_id=meeting.id,
        role=Role.HOST,
    )
    return token


def _add(
    unit: UnitOfWork, meeting: MeetingRow, model: ModelRow, motion_sequence_id: str | None
) -> PerformerRow:
    performer = PerformerRow(
        id=new_id(),
        person_id=model.person_id,
        model_id=model.id,
        motion_sequence_id=motion_sequence_id,
        name=unit.people.get(model.person_id).name,
        place=len(meeting.performers),
        x_m=0.0,
        y_m=0.0,
        z_m=0.0,
        yaw_rad=0.0,
    )
    meeting.performers.append(performer)
    return performer
