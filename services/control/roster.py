"""Who is in a meeting, as each of those in it may see."""

from __future__ import annotations

from datetime import datetime, timedelta

from db.models import Admission, MeetingRow, ParticipantRow, RecordingRow, Role
from services.control.messages import Member, RecordingUnderWay, Roster
from services.recording import consent
from services.seats import SEAT_LAPSES_S

SILENCE_S = 5.0
"""A page silent for so long is away; it has until its seat lapses to come back."""
_ORDER = {Role.HOST: 0, Role.SPEAKER: 1, Role.VIEWER: 2}


def is_attending(one: ParticipantRow, now: datetime) -> bool:
    """Whether somebody has come to the meeting and their seat has not lapsed."""
    return one.heard_at is not None and now - one.heard_at <= timedelta(seconds=SEAT_LAPSES_S)


def host_of(meeting: MeetingRow, now: datetime) -> ParticipantRow | None:
    """The host, if one is there."""
    for one in meeting.participants:
        if one.role is Role.HOST and one.admission is Admission.ADMITTED and is_attending(one, now):
            return one
    return None


def presenter_of(meeting: MeetingRow, now: datetime) -> str | None:
    """Who may share a screen: as long as they are there, let in, and more than a viewer."""
    return _one_who_may_present(meeting, meeting.presenter_id, now)


def _one_who_may_present(
    meeting: MeetingRow, participant_id: str | None, now: datetime
) -> str | None:
    for one in meeting.participants:
        if one.id == participant_id and one.role is not Role.VIEWER and is_attending(one, now):
            return one.id if one.admission is Admission.ADMITTED else None
    return None


def present_in(meeting: MeetingRow, now: datetime) -> dict[str, ParticipantRow]:
    """Participants who are there, let in or not, by id."""
    return {one.id: one for one in meeting.participants if is_attending(one, now)}


def roster_for(
    meeting: MeetingRow, participant_id: str, now: datetime, recording: RecordingRow | None = None
) -> Roster:
    """What a participant sees: everybody let in; the host also those who wait."""
    there = [one for one in meeting.participants if is_attending(one, now)]
    me = next((one for one in there if one.id == participant_id), None)
    seen = {Admission.ADMITTED} if me and me.admission is Admission.ADMITTED else set()
    if me is not None and me.role is Role.HOST:
        seen.add(Admission.WAITING)
    shown = [one for one in there if one.admission in seen or one is me]
    shown.sort(key=lambda one: (_ORDER[one.role], one.joined_at, one.id))
    performers = performers_by_participant(meeting, now)
    ids = [one.id for one in meeting.shown_at(now)]
    members = [
        _member(one, who if (who := performers.get(one.id)) in ids else None, now) for one in shown
    ]
    asks = _one_who_may_present(meeting, meeting.presenter_asks_id, now)
    sees_request = me is not None and (me.role is Role.HOST or me.id == asks)
    inside = me is not None and me.admission is Admission.ADMITTED
    return Roster(
        lobby=meeting.lobby,
        environment=meeting.environment,
        presenter_id=presenter_of(meeting, now) if inside else None,
        presenter_asks_id=asks if sees_request else None,
        recording=_recording(meeting, recording, now) if recording and inside else None,
        members=members,
        performer_ids=ids if inside else [],
    )


def _recording(meeting: MeetingRow, recording: RecordingRow, now: datetime) -> RecordingUnderWay:
    running = consent.all_agree(recording, present_in(meeting, now))
    agreed = sorted(consent.agreed_in(recording))
    return RecordingUnderWay(id=recording.id, running=running, agreed=agreed)


def performers_by_participant(meeting: MeetingRow, now: datetime) -> dict[str, str]:
    """Participant id -> id of the performer that represents them; each represents one at most.

    Those who may be shown come first; one who may not still says whose likeness somebody has.
    """
    found: dict[str, str] = {}
    shown = meeting.shown_at(now)
    performers = shown + [one for one in meeting.performers if one not in shown]
    there = present_in(meeting, now).values()
    for one in sorted(there, key=lambda one: one.joined_at):
        theirs = [p for p in performers if one.account and p.account == one.account]
        if theirs:
            performers.remove(theirs[0])
            found[one.id] = theirs[0].id
    return found


def _member(one: ParticipantRow, performer_id: str | None, now: datetime) -> Member:
    assert one.heard_at is not None
    return Member(
        id=one.id,
        name=one.display_name,
        role=one.role,
        admission=one.admission,
        present=now - one.heard_at <= timedelta(seconds=SILENCE_S),
        hand_at=one.hand_at,
        microphone=one.microphone,
        connection=one.connection,
        performer_id=performer_id,
    )
