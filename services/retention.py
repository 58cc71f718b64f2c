"""Deletes what has been kept as long as the settings say; the store's sweeper takes the rest."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta

from db.errors import NotFound
from services.audit import KEEPER, note
from services.container import Services
from services.errors import SequenceInUse
from services.jobs.queue import Orphan, discard, drop_orphans


@dataclass(frozen=True)
class Forgotten:
    """What was deleted."""

    recordings: int
    clips: int
    events: int


def forget_old(services: Services) -> Forgotten:
    """Delete recordings, clips and events whose time is over, each in a transaction of its own.

    A clip goes with its frames and its motion; models that were made of it stay. One that a job
    works on is left for the next time.
    """
    settings = services.settings.retention
    recordings = clips = 0
    if settings.recording_days is not None:
        recordings = _forget_recordings(services, timedelta(days=settings.recording_days))
    if settings.clip_days is not None:
        clips = _forget_clips(services, timedelta(days=settings.clip_days))
    with services.unit_of_work() as unit:
        before = services.clock() - timedelta(days=settings.audit_days)
        events = unit.audit.forget(before)
        unit.commit()
    return Forgotten(recordings, clips, events)


def _forget_recordings(services: Services, kept: timedelta) -> int:
    with services.reading() as unit:
        old = [one.id for one in unit.recordings.ended_before(services.clock() - kept)]
    for recording_id in old:
        with services.unit_of_work() as unit:
            recording = unit.recordings.get_for_change(recording_id)
            orphans = unit.recordings.remove(recording)
            note(services, unit, KEEPER, "recording.deleted", days=kept.days)
            unit.commit()
        drop_orphans(services, orphans)
    return len(old)


def _forget_clips(services: Services, kept: timedelta) -> int:
    with services.reading() as unit:
        old = [one.id for one in unit.sequences.created_before(services.clock() - kept)]
    forgotten = 0
    for sequence_id in old:
        try:
            orphans = _forget_clip(services, sequence_id)
        except (SequenceInUse, NotFound):  # not found: kept pictures have gone with their clip
            continue
        drop_orphans(services, orphans)
        forgotten += 1
    return forgotten


def _forget_clip(services: Services, sequence_id: str) -> list[Orphan]:
    with services.unit_of_work() as unit:
        sequence = unit.sequences.get(sequence_id)
        person_id, kind = sequence.person_id, str(sequence.kind)
        orphans = discard(unit, sequence)
        note(services, unit, KEEPER, "sequence.deleted", person_id, kind=kind)
        unit.commit()
    return orphans
