"""Who is in a meeting, as each of those in it may see."""

from __future__ import annotations

from datetime import datetime, timedelta

from db.models import MeetingRow, ParticipantRow, Role, Standing
from services.control.messages import Member, Roster
from services.seats import SEAT_LAPSES_S

SILENCE_S = 5.0
"""A page silent for so long is away; it has until its seat lapses to come back."""
_ORDER = {Role.HOST: 0, Role.SPEAKER: 1, Role.VIEWER: 2}


def is_there(one: ParticipantRow, now: datetime) -> bool:
    """Whether somebody has come to the meeting and their seat has not lapsed."""
    return one.heard_at is not None and now - one.heard_at <= timedelta(seconds=SEAT_LAPSES_S)


def host_of(meeting: MeetingRow, now: datetime) -> ParticipantRow | None:
    """The host, if one is there."""
    for one in meeting.participants:
        if one.role is Role.HOST and one.standing is Standing.ADMITTED and is_there(one, now):
            return one
    return None


def roster_for(meeting: MeetingRow, participant_id: str, now: datetime) -> Roster:
    """What a participant sees: everybody let in; the host also those who wait."""
    there = [one for one in meeting.participants if is_there(one, now)]
    me = next((one for one in there if one.id == participant_id), None)
    seen = {Standing.ADMITTED} if me and me.standing is Standing.ADMITTED else set()
    if me is not None and me.role is Role.HOST:
        seen.add(Standing.WAITING)
    shown = [one for one in there if one.standing in seen or one is me]
    shown.sort(key=lambda one: (_ORDER[one.role], one.joined_at, one.id))
    return Roster(lobby=meeting.lobby, members=[_member(one, now) for one in shown])


def _member(one: ParticipantRow, now: datetime) -> Member:
    assert one.heard_at is not None
    return Member(
        id=one.id,
        name=one.display_name,
        role=one.role,
        standing=one.standing,
        present=now - one.heard_at <= timedelta(seconds=SILENCE_S),
        hand_at=one.hand_at,
        microphone=one.microphone,
    )
