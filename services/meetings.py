"""Meetings: who is in them, and how others are asked in."""

from __future__ import annotations

from datetime import datetime, timedelta
from urllib.parse import quote

from db.errors import NotFound
from db.models import MeetingRow, ModelRow, PerformerRow, Purpose, Role, new_id
from db.repositories import UnitOfWork
from scene.motion import Motion
from scene.skeleton import Skeleton
from services.arrangement import (
    DefaultViewpoint,
    Placed,
    first_free,
    place,
    view_from_a_place,
    view_from_the_front,
)
from services.auth import INVITED
from services.container import Services
from services.errors import MeetingFull, MeetingSealed
from services.likeness import require_consent
from services.live.eye_level import with_level_gaze
from services.live.room import eye_height, facing_yaw
from services.motions import motion_of
from services.person_models import VIEWER_FILE

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
    sealed: bool = False,
) -> MeetingRow:
    """A new meeting with `models` standing in it; with `lobby`, who comes waits to be let in; with
    `sealed`, motion travels encrypted between pages.

    Raises NoConsent for a model whose person does not consent to meetings, and MeetingSealed for
    one that pages cannot draw where it is sealed.
    """
    meeting = MeetingRow(
        id=new_id(),
        account=account,
        name=name,
        label=label,
        created_at=services.clock(),
        lobby=lobby,
        sealed=sealed,
    )
    unit.meetings.add(meeting)
    unit.flush()
    for model in models:
        _add(services, unit, meeting, model, None)
    return meeting


def add_performer(
    services: Services,
    unit: UnitOfWork,
    meeting: MeetingRow,
    model: ModelRow,
    motion_sequence_id: str | None = None,
    *,
    brought: bool = False,
) -> PerformerRow:
    """One more performer at the first free place, who moves by a sequence's motion or by the
    model's own.

    One who is `brought` by their owner, who is invited, takes the place of whom they brought
    before. Brought performers whose owner is gone make room.

    Raises MeetingFull, NotCaptured where the sequence has no motion, NoConsent, or MeetingSealed
    where the meeting is sealed and a page can't draw the model, or a sequence is to move it.
    """
    stay = meeting.accounts_at(services.clock())
    if brought:
        stay -= {unit.people.get(model.person_id).account}
    for one in [one for one in meeting.performers if one.brought and one.account not in stay]:
        meeting.performers.remove(one)
    unit.flush()
    if len(meeting.performers) >= MOST_PERFORMERS:
        raise MeetingFull(
            f"a meeting must have at most {MOST_PERFORMERS} performers; got one more; "
            "remove somebody first",
        )
    return _add(services, unit, meeting, model, motion_sequence_id, brought)


def take_along(meeting: MeetingRow, account: str, now: datetime) -> None:
    """Whom somebody brought who has just left goes with them, but for another seat of theirs."""
    if account in meeting.accounts_at(now):
        return
    for one in [one for one in meeting.performers if one.brought and one.account == account]:
        meeting.performers.remove(one)


def remove_performer(meeting: MeetingRow, performer_id: str) -> None:
    """One performer less; the others stay where they are. Raises NotFound for one who is not
    there."""
    found = [one for one in meeting.performers if one.id == performer_id]
    if not found:
        raise NotFound(
            f"id must be that of a performer of this meeting; got {performer_id!r}; "
            "read the meeting to see who is there",
        )
    meeting.performers.remove(found[0])


def measure(performer: PerformerRow, skeleton: Skeleton, motion: Motion) -> None:
    """Note which way a performer of `skeleton` faces in `motion`, and how high their eyes are."""
    performer.front_yaw_rad = facing_yaw(motion)
    performer.eye_height_m = eye_height(skeleton, motion)


def position(performer: PerformerRow) -> tuple[float, float, float]:
    """Where a performer is, m."""
    x_m, z_m, _ = place(performer.place)
    return x_m, 0.0, z_m


def yaw(performer: PerformerRow) -> float:
    """Turn (rad about +y) of a performer's model, so that they face the others."""
    return place(performer.place)[2] + performer.front_yaw_rad


def placed(performer: PerformerRow) -> Placed:
    """Where a performer is, which way they face there, and how high their eyes are."""
    return Placed(*place(performer.place), performer.eye_height_m)


def default_viewpoint(meeting: MeetingRow, account: str, now: datetime) -> DefaultViewpoint:
    """From where a page of `account` sees a meeting at first, which it enters at `now`.

    Whoever takes part as themselves looks from their own place. Whoever only watches, or brought
    several people, or had theirs moved by another clip, stands in front of everybody.
    """
    shown = meeting.shown_at(now)
    own = [p for p in shown if p.account == account and p.motion_sequence_id is None]
    if len(own) != 1:
        return view_from_the_front([placed(one) for one in shown])
    others = [placed(one) for one in shown if one is not own[0]]
    return view_from_a_place(placed(own[0]), others)


def performed_motion(services: Services, unit: UnitOfWork, performer: PerformerRow) -> Motion:
    """How a performer moves: as the sequence that was lent to them, else as they were filmed, with
    their head held level."""
    if performer.motion_sequence_id is not None:
        return motion_of(services, unit, performer.motion_sequence_id)
    model = services.models.load_row(unit.models.get(performer.model_id))
    return with_level_gaze(model.skeleton, model.motion)


def join_url(services: Services, meeting: MeetingRow) -> str:
    """The link to send. It carries a token for this meeting where access is not open, or where the
    invitation was renewed."""
    settings = services.settings
    url = f"{settings.server.public_url.rstrip('/')}/?meeting={quote(meeting.id)}"
    if settings.security.open_access and meeting.invitation == 0:
        return url
    token, _ = services.tokens.issue(
        INVITED,
        frozenset({"join"}),
        _LINK_LIFETIME,
        meeting_id=meeting.id,
        invitation=meeting.invitation,
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
    services: Services,
    unit: UnitOfWork,
    meeting: MeetingRow,
    model: ModelRow,
    motion_sequence_id: str | None,
    brought: bool = False,
) -> PerformerRow:
    if meeting.sealed:
        _require_sealable(model, motion_sequence_id)
    person = unit.people.get(model.person_id)
    require_consent(person, Purpose.MEETINGS, services.clock())
    performer = PerformerRow(
        id=new_id(),
        person_id=model.person_id,
        model_id=model.id,
        motion_sequence_id=motion_sequence_id,
        name=person.name,
        brought=brought,
        place=first_free([one.place for one in meeting.performers]),
    )
    skeleton = services.models.load_row(model).skeleton
    measure(performer, skeleton, performed_motion(services, unit, performer))
    meeting.performers.append(performer)
    return performer


def _require_sealable(model: ModelRow, motion_sequence_id: str | None) -> None:
    """Raises MeetingSealed for whom pages alone cannot draw, or cannot move."""
    if all(one.name != VIEWER_FILE for one in model.files):
        raise MeetingSealed(
            "whoever stands in a sealed meeting must have a model of splats, which pages draw; "
            f"got one of the preset {model.preset!r}; train one with the preset splats"
        )
    if motion_sequence_id is not None:
        raise MeetingSealed(
            "whoever stands in a sealed meeting must move by their own page; got a stored motion, "
            "which this server would have to play; leave motion_sequence_id out"
        )
