"""With consent a model learns from kept pictures beside its clip, and replaces the old one."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from db.errors import NotFound
from db.models import (
    JobKind,
    JobRow,
    JobState,
    Purpose,
    SequenceKind,
    SequenceRow,
    SequenceState,
    new_id,
)
from services.container import Services
from services.errors import NoConsent
from services.jobs.packing import pack
from services.jobs.queue import discard, enqueue
from tests.services import seeds
from tests.services.jobs.teaching import run_next_training


@pytest.fixture
def clip(services: Services, sequence_folder: Path) -> SequenceRow:
    return seeds.captured(services, sequence_folder)


@pytest.fixture
def kept(services: Services, clip: SequenceRow, sequence_folder: Path) -> SequenceRow:
    """Pictures that were kept for the clip."""
    packed = pack(services.objects, clip.person_id, sequence_folder)
    row = SequenceRow(
        id=new_id(),
        person_id=clip.person_id,
        kind=SequenceKind.LIVE,
        state=SequenceState.READY,
        created_at=services.clock(),
        source_name="live look",
        source_sha256="1" * 64,
        packed_sha256=packed.sha256,
        clip_id=clip.id,
    )
    with services.unit_of_work() as unit:
        unit.sequences.add(row)
        unit.commit()
    return row


def trained(
    services: Services, folder: Path, sequence: SequenceRow, improves: str | None
) -> JobRow:
    """The job once it has run, in this process."""
    params = {"preset": "splats", "budget_s": 0.5, "seed": 0, "improves": improves}
    with services.unit_of_work() as unit:
        enqueue(unit, JobKind.TRAIN, sequence, params, services.clock())
        unit.commit()
    return run_next_training(services, folder)


def models(services: Services, person_id: str) -> list[str]:
    with services.reading() as unit:
        rows = unit.models.of_person(person_id)
        return [one.id for one in rows if one.superseded_at is None]


def test_with_consent_alone_a_model_learns_more_and_takes_the_place_of_the_old(
    services: Services, clip: SequenceRow, kept: SequenceRow, tmp_path: Path
):
    first = trained(services, tmp_path / "a", clip, None).model_id
    with pytest.raises(NoConsent):
        trained(services, tmp_path / "b", kept, first)
    assert models(services, clip.person_id) == [first]
    with services.unit_of_work() as unit:
        unit.people.get(clip.person_id).consent_purposes = [one.value for one in Purpose]
        unit.commit()
    job = trained(services, tmp_path / "c", kept, first)
    assert job.state is JobState.SUCCEEDED
    assert models(services, clip.person_id) == [job.model_id]
    with services.reading() as unit:
        model = unit.models.get(job.model_id or "")
    assert model.sequence_id == clip.id, "the next round is held to the same clip"
    assert "held_to" in model.metrics
    again = trained(services, tmp_path / "d", kept, job.model_id)
    assert again.state is JobState.SUCCEEDED


def test_without_their_clip_they_go_too(services: Services, clip: SequenceRow, kept: SequenceRow):
    with services.unit_of_work() as unit:
        orphans = discard(unit, unit.sequences.get(clip.id))
        unit.commit()
    assert (kept.person_id, kept.packed_sha256) in orphans
    with services.reading() as unit, pytest.raises(NotFound):
        unit.sequences.get(kept.id)


async def test_they_make_no_model_by_themselves(
    client: httpx.AsyncClient, services: Services, kept: SequenceRow
):
    answer = await client.post(f"/v1/sequences/{kept.id}/models", json={"budget_s": 1.0})
    assert answer.status_code == 422, answer.text
