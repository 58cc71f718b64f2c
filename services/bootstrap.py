"""What must be there before the first visitor: the demo's performer and its meeting."""

from __future__ import annotations

import tempfile
from pathlib import Path

from db.models import MeetingRow, ModelRow, PersonRow, Purpose, new_id
from db.objects import file_chunks
from db.repositories import UnitOfWork
from renderer.model_files import load_model
from services.auth import GUEST
from services.container import Services
from services.jobs.queue import drop_orphans
from services.meetings import DEMO, add_performer, create_meeting
from services.person_models import store_files, write_files

DEMO_MODEL = Path(__file__).parent / "assets" / "demo.safetensors"
"""Made by `python -m tools.build_demo`."""


def ensure_demo(services: Services, model_path: Path, name: str) -> str:
    """The id of the demo's meeting, where `model_path` stands as `name`; made if it is not there.

    Call it after the database is migrated. A performer who was erased comes back with the next
    call.
    """
    with services.reading() as unit:
        meeting = unit.meetings.with_label(DEMO)
    if meeting is not None and meeting.performers:
        return meeting.id
    model = import_model(services, model_path, GUEST, name)
    with services.unit_of_work() as unit:
        row = unit.models.get(model.id)
        meeting = _renewed(services, unit, row)
        unit.commit()
    return meeting.id


def import_model(services: Services, path: Path, account: str, name: str) -> ModelRow:
    """Store a trained model file as that of a new person called `name`. Raises BrokenModel."""
    trained = load_model(path)
    now = services.clock()
    person = PersonRow(id=new_id(), account=account, name=name, created_at=now)
    if account == GUEST:  # the demo lends its people to whoever comes
        person.consent_purposes = list(Purpose)
    row = ModelRow(
        id=new_id(),
        person_id=person.id,
        preset=trained.preset,
        created_at=now,
        data_hash=trained.data_hash,
        metrics=trained.metrics,
    )
    with tempfile.TemporaryDirectory() as folder:
        row.files = store_files(
            lambda file: services.objects.put(person.id, file_chunks(file)),
            person.id,
            write_files(trained, Path(folder)),
        )
    try:
        with services.unit_of_work() as unit:
            unit.people.add(person)
            unit.flush()
            unit.models.add(row)
            unit.commit()
    except BaseException:
        drop_orphans(services, [(person.id, file.sha256) for file in row.files])
        raise
    return row


def _renewed(services: Services, unit: UnitOfWork, model: ModelRow) -> MeetingRow:
    meeting = unit.meetings.with_label(DEMO)
    if meeting is None:
        return create_meeting(services, unit, GUEST, "The demo", [model], label=DEMO)
    add_performer(services, unit, meeting, model)
    return meeting
