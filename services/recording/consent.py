"""Who agreed to be recorded: nothing is kept while anybody present has not.

The host asks, which is their own consent; everybody else agrees by themselves. Whoever comes later
is asked too, and until they answer the recording rests. A no, at first or later, ends it. Beyond
that, nothing is kept of whom a person represents whose likeness is not for recordings
(`services.likeness`).
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime

from db.models import (
    Admission,
    MeetingRow,
    ParticipantRow,
    PerformerRow,
    Purpose,
    RecordingMemberRow,
    RecordingRow,
    RecordingState,
    new_id,
)
from db.repositories import UnitOfWork
from services.errors import NothingRecorded


def ask(
    unit: UnitOfWork,
    meeting: MeetingRow,
    host: ParticipantRow,
    performer_id: str | None,
    now: datetime,
) -> None:
    """Ask everybody; asking again changes nothing."""
    if unit.recordings.under_way(meeting.id) is not None:
        return
    recording = RecordingRow(
        id=new_id(),
        meeting_id=meeting.id,
        account=host.account,
        name=meeting.name,
        state=RecordingState.ASKING,
        asked_at=now,
        duration_ms=0,
        bytes=0,
    )
    unit.recordings.add(recording)
    _note(recording, meeting, host, performer_id, now, agreed=True)


def answer(
    unit: UnitOfWork,
    meeting: MeetingRow,
    me: ParticipantRow,
    performer_id: str | None,
    now: datetime,
    *,
    agreed: bool,
) -> None:
    """Note what somebody says to it. Raises NothingRecorded where nobody asked."""
    recording = unit.recordings.under_way(meeting.id)
    if recording is None:
        raise NothingRecorded("whoever agrees must have been asked; got an answer to no one")
    # who withdraws had agreed until now: what was kept so far stays theirs to see and take out
    if agreed or me.id not in agreed_in(recording):
        _note(recording, meeting, me, performer_id, now, agreed=agreed)
    if not agreed:
        end(recording, f"{me.display_name} did not agree", now)


def end(recording: RecordingRow, why: str, now: datetime) -> None:
    """Keep no more; ending what has ended changes nothing."""
    if recording.state is not RecordingState.ENDED:
        recording.state, recording.ended_at = RecordingState.ENDED, now
        recording.why_ended = why[:200]


def recordable(meeting: MeetingRow, now: datetime) -> list[PerformerRow]:
    """The performers who are shown and whose people consent to recordings at `now`."""
    shown = meeting.shown_at(now)
    return [one for one in shown if one.person.consents_to(Purpose.RECORDINGS, now)]


def all_agree(recording: RecordingRow, present: Mapping[str, ParticipantRow]) -> bool:
    """Whether everybody who is there and let in has agreed, and somebody is."""
    agreed = agreed_in(recording)
    inside = [who for who, one in present.items() if one.admission is Admission.ADMITTED]
    return bool(inside) and all(who in agreed for who in inside)


def agreed_in(recording: RecordingRow) -> set[str]:
    """Ids of the participants who agreed."""
    return {one.participant_id for one in recording.members if one.agreed}


def _note(
    recording: RecordingRow,
    meeting: MeetingRow,
    me: ParticipantRow,
    performer_id: str | None,
    now: datetime,
    *,
    agreed: bool,
) -> None:
    kept = {one.id: one.person_id for one in recordable(meeting, now)}
    found = [one for one in recording.members if one.participant_id == me.id]
    member = found[0] if found else RecordingMemberRow(participant_id=me.id)
    member.account, member.name, member.agreed = me.account, me.display_name, agreed
    member.performer_id = performer_id if performer_id in kept else None
    member.person_id = kept.get(performer_id) if performer_id else None
    if not found:
        recording.members.append(member)
