"""Erases a person: every row, every object, and the proof that nothing is left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime

from db.models import AuditEventRow
from db.objects import Objects
from db.repositories import UnitOfWork


@dataclass(frozen=True)
class Erasure:
    """What went, and what is left."""

    deleted_rows: dict[str, int]
    """By table."""
    deleted_objects: int
    remaining: int
    """Rows and objects counted afterwards; 0 is the proof."""


def erase_person(
    open_unit: Callable[[], UnitOfWork],
    objects: Objects,
    person_id: str,
    account: str,
    now: datetime,
) -> Erasure:
    """Erase everything of `person_id`. Raises NotFound.

    Rows go first: should the store fail half-way, nothing points at bytes that are gone, and what
    is left is an orphan that the sweeper takes. The event that stays names nobody. Videos that were
    made of recordings with them go whole: nobody can be taken out of a picture.
    """
    with open_unit() as unit:
        videos = unit.recordings.drop_exports(unit.recordings.with_person(person_id))
        rows = unit.people.erase(person_id)
        if videos:
            rows["recording_export"] = len(videos)
        unit.audit.add(
            AuditEventRow(at=now, account=account, action="person.erased", details={"rows": rows})
        )
        unit.commit()
    for video in videos:
        objects.delete(video.person_id, video.sha256)
    deleted = len(videos) + objects.delete_all(person_id)
    with open_unit() as unit:
        remaining = unit.people.count_rows(person_id) + sum(1 for _ in objects.list(person_id))
    return Erasure(rows, deleted, remaining)
