"""Pictures of live look that somebody chose to keep: a sequence of their model's next training."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from capture.storage import write_sequence
from db.errors import NotFound
from db.models import (
    AuditEventRow,
    JobKind,
    JobRow,
    ModelRow,
    PerformerRow,
    PersonRow,
    Purpose,
    SequenceKind,
    SequenceRow,
    SequenceState,
    new_id,
)
from db.objects import StoredObject
from db.repositories import UnitOfWork
from renderer.live_look.frame_keeper import KeptFrame, Side, sides_shown
from renderer.live_look.learning import training_frames
from renderer.splats.model import SplatModel
from scene.arrays import Array, UInt8
from scene.body import Body
from scene.sequence import PoseTrust
from services.container import Services
from services.jobs import packing
from services.jobs.events import QUEUE
from services.jobs.queue import Orphan, cancel, clip_gone, drop_orphans, enqueue, forget
from services.jobs.scratch import scratch_folder
from services.likeness import require_consent

BUDGET_S = 20.0
"""Of the training that follows."""
_RATE = 15.0
_ACROSS, _CELL_PX = 6, 96
"""Of a contact sheet."""


def require_learnable(unit: UnitOfWork, person: PersonRow, model: ModelRow, now: datetime) -> str:
    """The id of the clip with which pictures of `person` are trained on.

    Raises NoConsent, and ClipGone where nothing is left of the clip that could be held against what
    is learnt.
    """
    require_consent(person, Purpose.LEARNING, now)
    if model.sequence_id is None:
        raise clip_gone()
    if unit.sequences.get(model.sequence_id).packed_sha256 is None:
        raise clip_gone()
    return model.sequence_id


def performer_row(unit: UnitOfWork, meeting_id: str, performer_id: str) -> PerformerRow:
    """A performer of a meeting. Raises NotFound."""
    for performer in unit.meetings.get(meeting_id).performers:
        if performer.id == performer_id:
            return performer
    raise NotFound(
        f"id must be that of a performer of the meeting; got {performer_id!r}, who has left"
    )


def store_kept(
    services: Services,
    account: str,
    performer_id: str,
    meeting_id: str,
    model: SplatModel,
    kept: list[KeptFrame],
) -> JobRow:
    """Store what was kept of a performer, seen as `model`, and queue the training from it.

    All of it or nothing. Raises NotFound, NoConsent, ClipGone.
    """
    put: list[Orphan] = []

    def note(stored: StoredObject, owner: str) -> str:
        put.append((owner, stored.sha256))
        return stored.sha256

    try:
        with services.unit_of_work() as unit:
            performer = performer_row(unit, meeting_id, performer_id)
            row, person = unit.models.get(performer.model_id), performer.person
            now = services.clock()
            clip_id = require_learnable(unit, person, row, now)
            packed = note(_packed(services, person.id, model, kept), person.id)
            sheet = note(services.objects.put(person.id, [contact_sheet(kept)]), person.id)
            sequence = SequenceRow(
                id=new_id(),
                person_id=person.id,
                kind=SequenceKind.LIVE,
                state=SequenceState.READY,
                created_at=now,
                source_name="live look",
                source_sha256=packed,
                packed_sha256=packed,
                thumbnail_sha256=sheet,
                frames=len(kept),
                quality={"sides": [side_words(one) for one in sides_shown(kept)]},
                clip_id=clip_id,
            )
            unit.sequences.add(sequence)
            unit.flush()
            params = {"preset": "splats", "budget_s": BUDGET_S, "seed": 0, "improves": row.id}
            within = services.tracing.here()
            job = enqueue(unit, JobKind.TRAIN, sequence, params, now, within)
            details: dict[str, Any] = {"kind": str(SequenceKind.LIVE), "frames": len(kept)}
            unit.audit.add(
                AuditEventRow(
                    person_id=person.id,
                    at=now,
                    account=account,
                    action="sequence.kept",
                    details=details,
                )
            )
            unit.commit()
    except BaseException:
        drop_orphans(services, put)
        raise
    services.events.publish(QUEUE)
    return job


def forget_kept(unit: UnitOfWork, person: PersonRow, now: datetime) -> list[Orphan]:
    """Drop the pictures that were kept of a person, unless they consent to learning from them at
    `now`, and stop what learns from them; models stay."""
    if person.consents_to(Purpose.LEARNING, now):
        return []
    orphans: list[Orphan] = []
    for sequence in unit.sequences.of_person(person.id):
        if sequence.kind is SequenceKind.LIVE and sequence.state is SequenceState.READY:
            jobs = unit.jobs.of_sequence(sequence.id)
            for job in jobs:
                if not job.state.final:
                    orphans += cancel(unit, job, now)
            orphans += forget(sequence, jobs)
    return orphans


def side_words(side: Side) -> str:
    """As `head from 60 degrees to their left, from above`."""
    way = {0: "", 1: ", from above", -1: ", from below"}[side.elevation]
    if side.azimuth_deg in (0, -180):
        return f"{side.part} from {'the front' if side.azimuth_deg == 0 else 'behind'}{way}"
    to = "left" if side.azimuth_deg > 0 else "right"
    return f"{side.part} from {abs(side.azimuth_deg)} degrees to their {to}{way}"


def thumbnail(frame: KeptFrame) -> UInt8[Array, "_ _ 3"]:
    """A small sRGB picture of the person over white."""
    picture = frame.picture
    alpha = picture.matte[..., None] / np.float32(255.0)
    white = (picture.rgb * alpha + 255.0 * (1.0 - alpha) + 0.5).astype(np.uint8)
    height, width = white.shape[:2]
    scale = _CELL_PX / max(height, width)
    size = (max(1, round(scale * width)), max(1, round(scale * height)))
    small = np.asarray(cv2.resize(white, size, interpolation=cv2.INTER_AREA))
    cell = np.full((_CELL_PX, _CELL_PX, 3), 255, np.uint8)
    left, top = (_CELL_PX - size[0]) // 2, (_CELL_PX - size[1]) // 2
    cell[top : top + size[1], left : left + size[0]] = small
    return cell


def contact_sheet(kept: Iterable[KeptFrame]) -> bytes:
    """Small pictures of all `kept`, as PNG."""
    cells = [thumbnail(one) for one in kept]
    cells += [np.full_like(cells[0], 255)] * (-len(cells) % min(_ACROSS, len(cells)))
    across = min(_ACROSS, len(cells))
    rows = [np.concatenate(cells[at : at + across], axis=1) for at in range(0, len(cells), across)]
    return png(np.concatenate(rows))


def png(picture: UInt8[Array, "H W 3"]) -> bytes:
    """`picture`, sRGB, as PNG."""
    return cv2.imencode(".png", picture[..., ::-1])[1].tobytes()


def write_kept(folder: Path, model: SplatModel, kept: Iterable[KeptFrame]) -> None:
    """Write what was kept of whom `model` shows, as a sequence in `folder`."""
    write_sequence(
        folder,
        person="",
        frames_per_second=_RATE,
        body=Body(model.skeleton),
        train=training_frames(kept),
        source="live look",
        pose_trust=PoseTrust.ESTIMATED,
    )


def _packed(
    services: Services, owner: str, model: SplatModel, kept: list[KeptFrame]
) -> StoredObject:
    with scratch_folder(services.settings.folders.scratch_dir) as folder:
        write_kept(folder / "sequence", model, kept)
        return packing.pack(services.objects, owner, folder / "sequence")
