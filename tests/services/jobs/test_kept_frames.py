"""With consent a model learns from kept pictures beside its clip, and replaces the old one."""

from __future__ import annotations

from pathlib import Path

import pytest

from db.models import Purpose, SequenceKind, SequenceRow, SequenceState, new_id
from services.composition import build_services
from services.jobs.packing import pack
from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import changed, serving
from tests.services.jobs.waiting import job_when


@pytest.fixture
def working(settings: Settings) -> Settings:
    """Settings of a gateway that runs jobs."""
    return changed(settings, embedded_worker=True)


@pytest.fixture
def rows(working: Settings, sequence_folder: Path) -> tuple[str, str, str]:
    """Ids of a person, their clip, and pictures kept for it."""
    services = build_services(working)
    services.database.migrate()
    clip = seeds.captured(services, sequence_folder)
    packed = pack(services.objects, clip.person_id, sequence_folder)
    kept = SequenceRow(
        id=new_id(),
        person_id=clip.person_id,
        kind=SequenceKind.LIVE,
        state=SequenceState.READY,
        created_at=services.clock(),
        source_name="live look",
        source_sha256=packed.sha256,
        packed_sha256=packed.sha256,
        clip_id=clip.id,
    )
    with services.unit_of_work() as unit:
        unit.sequences.add(kept)
        unit.commit()
    services.close()
    return clip.person_id, clip.id, kept.id


def test_with_consent_alone_a_model_goes_on_to_learn_and_takes_the_place_of_the_old(
    working: Settings, rows: tuple[str, str, str]
):
    person_id, clip_id, kept_id = rows

    with serving(working) as caller:

        def trained(sequence_id: str, **params: object) -> dict:
            answer = caller.post(f"/v1/sequences/{sequence_id}/models", json=params)
            assert answer.status_code == 202, answer.text
            ended = {"succeeded", "failed"}
            return job_when(caller, answer.json()["id"], lambda job: job["state"] in ended, "end")

        first = trained(clip_id, budget_s=1.0)["model_id"]
        alone = caller.post(f"/v1/sequences/{kept_id}/models", json={"budget_s": 1.0})
        assert alone.status_code == 422, "pictures of a side make no model by themselves"
        refused = trained(kept_id, budget_s=1.0, improves=first)
        assert refused["error"]["type"] == "urn:metanerf:no-consent"
        models = caller.get("/v1/models").json()["items"]
        assert [one["id"] for one in models] == [first]
        consent = {"purposes": [one.value for one in Purpose], "until": None}
        assert caller.put(f"/v1/people/{person_id}/consent", json=consent).status_code == 200
        learnt = trained(kept_id, budget_s=1.0, improves=first)
        assert learnt["error"] is None
        (model,) = caller.get("/v1/models").json()["items"]
        assert model["id"] == learnt["model_id"] != first
        assert model["sequence_id"] == clip_id, "the next round holds it to the same clip"
        assert "held_to" in model["metrics"]
        again = trained(kept_id, budget_s=1.0, improves=model["id"])
        assert again["state"] == "succeeded"
        assert caller.delete(f"/v1/sequences/{clip_id}").status_code == 204
        assert caller.get(f"/v1/sequences/{kept_id}").status_code == 404
