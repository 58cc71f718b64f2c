"""Seats in meetings: taken by joining, kept by looking, given back by leaving.

A seat is a row, so that every gateway counts the same. Whoever joins has `SEAT_LAPSES_S` to open a
view; a view tells of its seat every `BEAT_S`, and gives it back when it ends. What a dead gateway
or a guest who never came to look leaves behind lapses, and the next to join finds it free.
"""

from __future__ import annotations

from datetime import timedelta
from itertools import count

from db.models import MeetingRow, ParticipantRow, new_id
from db.repositories import UnitOfWork
from services.auth import Principal
from services.container import Services
from services.problems import ProblemError

MOST_SEATS = 100
"""Viewers of one meeting, of all gateways."""
SEAT_LAPSES_S = 30.0
BEAT_S = 10.0
_RETRY_AFTER_S = 15
_TOKEN_LIFETIME = timedelta(hours=12)


def take_seat(
    services: Services, unit: UnitOfWork, meeting: MeetingRow, caller: Principal, display_name: str
) -> tuple[ParticipantRow, str]:
    """The first free seat of a meeting that is locked for it, and the token that opens its view.

    Raises a 503 problem with `Retry-After` when every seat is taken.
    """
    now = services.clock()
    lapsed = now - timedelta(seconds=SEAT_LAPSES_S)
    for gone in [one for one in meeting.participants if one.seen_at < lapsed]:
        meeting.participants.remove(gone)
    unit.flush()
    taken = {one.seat for one in meeting.participants}
    if len(taken) >= MOST_SEATS:
        raise ProblemError(
            503,
            "no-seat",
            f"a meeting must have at most {MOST_SEATS} viewers; got one more; try again when "
            "somebody has left",
            headers={"Retry-After": str(_RETRY_AFTER_S)},
        )
    participant = ParticipantRow(
        id=new_id(),
        display_name=display_name,
        seat=next(seat for seat in count(1) if seat not in taken),
        joined_at=now,
        seen_at=now,
    )
    meeting.participants.append(participant)
    token, _ = services.tokens.issue(
        caller.account, frozenset({"join"}), _TOKEN_LIFETIME, meeting.id, participant.id
    )
    return participant, token


def keep_seats(services: Services, participant_ids: set[str]) -> set[str]:
    """Say that somebody looks from these seats; returns those that are still theirs."""
    with services.unit_of_work() as unit:
        kept = unit.meetings.seen(participant_ids, services.clock())
        unit.commit()
    return kept


def require_seat(services: Services, participant_id: str) -> None:
    """Raise a 403 problem where this seat was given back."""
    if not keep_seats(services, {participant_id}):
        raise ProblemError(
            403,
            "seat-given-back",
            "the token must be of a seat that is taken; got one whose seat was given back; "
            "join the meeting again",
        )


def give_back(services: Services, participant_ids: set[str]) -> None:
    """Free these seats."""
    with services.unit_of_work() as unit:
        unit.meetings.drop_participants(participant_ids)
        unit.commit()
