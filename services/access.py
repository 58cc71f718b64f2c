"""Finds rows for a caller: those of the caller's account, and what the demo lends to guests."""

from __future__ import annotations

from db.models import JobRow, MeetingRow, ModelRow, PersonRow, SequenceRow
from db.repositories import UnitOfWork
from services.auth import Principal


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


def meeting_of(unit: UnitOfWork, caller: Principal, meeting_id: str) -> MeetingRow:
    """The meeting, locked for a change, if the caller may use it."""
    meeting = unit.meetings.get_for_change(meeting_id)
    caller.require_use(meeting.account)
    return meeting
