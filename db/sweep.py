"""Removes what nobody points at: objects without rows, chunks of dead writers, stale uploads,
models whose place a better one has taken.

An object is young until `grace` has passed, since its row is written after it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta

from db.objects import Objects
from db.repositories import UnitOfWork

GRACE = timedelta(hours=6)
"""Longer than any upload or job holds bytes before it writes their row."""
UPLOAD_LIFETIME = timedelta(days=2)
"""How long an interrupted upload may be gone on with."""


@dataclass(frozen=True)
class SweepResult:
    """What a sweep removed."""

    objects: int
    incoming: int
    uploads: int


def sweep(
    open_unit: Callable[[], UnitOfWork],
    objects: Objects,
    now: datetime,
    *,
    grace: timedelta = GRACE,
    upload_lifetime: timedelta = UPLOAD_LIFETIME,
) -> SweepResult:
    """Sweep the store once; safe beside running uploads and jobs."""
    with open_unit() as unit:
        stale = unit.uploads.started_before(now - upload_lifetime)
        for upload in stale:
            unit.uploads.remove(upload)
        for model in unit.models.superseded_before(now - grace):
            unit.models.remove(model)
        unit.commit()
    removed = 0
    for owner in objects.owners():
        # listed before the rows are read: an object that gets its row in between is spared
        old = [info for info in objects.list(owner) if info.modified_at < now - grace]
        if not old:
            continue
        with open_unit() as unit:
            used = unit.references.of_owner(owner)
        for info in old:
            if info.sha256 not in used:
                objects.delete(owner, info.sha256)
                removed += 1
    dead = [name for name, modified_at in objects.incoming() if modified_at < now - grace]
    for name in dead:
        objects.drop_incoming(name)
    return SweepResult(removed, len(dead), len(stale))
