"""Finds rows for a caller: those of the caller's account, and what the demo lends to guests."""

from __future__ import annotations

from db.models import (
    JobRow,
    ModelRow,
    PersonRow,
    RecordingMemberRow,
    RecordingRow,
    SequenceRow,
)
from db.repositories import UnitOfWork
from services.auth import INVITED, Principal
from services.errors import NotInRecording


def person_of(unit: UnitOfWork, caller: Principal, person_id: str) -> PersonRow:
    """The person, if it is the caller's. Raises NotFound, NotOwner."""
    person = unit.people.get(person_id)
    caller.require_account(person.account)
    return person


def sequence_of(unit: UnitOfWork, caller: Principal, sequence_id: str) -> SequenceRow:
    """The sequence, if it is the caller's."""
    sequence = unit.sequences.get(sequence_id)
    person_of(unit, caller, sequence.person_id)
    return sequence


def model_of(unit: UnitOfWork, caller: Principal, model_id: str) -> ModelRow:
    """The model, if the caller may use it."""
    model = unit.models.get(model_id)
    caller.require_use(unit.people.get(model.person_id).account)
    return model


def job_of(unit: UnitOfWork, caller: Principal, job_id: str) -> JobRow:
    """The job, if it is the caller's."""
    job = unit.jobs.get(job_id)
    person_of(unit, caller, job.person_id)
    return job


def recording_of(unit: UnitOfWork, caller: Principal, recording_id: str) -> RecordingRow:
    """The recording, if the caller asked for it or agreed to it. Raises NotFound, OtherMeeting,
    NotInRecording."""
    return require_part(unit.recordings.get(recording_id), caller)


def require_part(recording: RecordingRow, caller: Principal) -> RecordingRow:
    """The recording again, if the caller asked for it or agreed to it. Raises OtherMeeting,
    NotInRecording."""
    caller.require_meeting(recording.meeting_id)
    if not has_part(recording, caller):
        raise NotInRecording(
            "the token must be of somebody who agreed to be recorded, or asked for it; got one of "
            "somebody else",
        )
    return recording


def has_part(recording: RecordingRow, caller: Principal) -> bool:
    """Whether the caller asked for a recording or agreed to it.

    The account of invitations is of many people, so that one of them is known by their seat.
    """
    if caller.meeting_id not in (None, recording.meeting_id):
        return False
    mine = [one for one in recording.members if one.agreed and is_mine(one, caller)]
    asked = recording.account == caller.account and caller.account != INVITED
    return asked or bool(mine)


def is_mine(member: RecordingMemberRow, caller: Principal) -> bool:
    """Whether somebody in a recording is the caller."""
    if caller.account == INVITED:
        return member.participant_id == caller.participant_id
    return member.account == caller.account
