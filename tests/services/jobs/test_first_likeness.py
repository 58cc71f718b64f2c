"""A first likeness by a real gateway and landmark model: met early, replaced, never lost."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from sqlalchemy import select

from capture.storage import open_sequence
from db.models import JobKind, JobRow, JobState, ModelRow, SequenceState
from renderer.errors import TrainingError
from scene.sequence import Sequence
from services.composition import build_services
from services.container import Services
from services.jobs.first_likeness import make_first_likeness
from services.jobs.lease import JobLease
from services.jobs.packing import unpack
from services.jobs.queue import enqueue
from services.jobs.report import Reporter
from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import changed, serving, stored_files
from tests.services.jobs.waiting import child_of, job_when, until

HEIGHT_M = 1.9
_CLIPS = 5
"""Of which one is still captured when its likeness is seen."""


@pytest.fixture
def working(settings: Settings, pose_model: Path) -> Settings:
    return changed(settings, embedded_worker=True, pose_model=pose_model)


@pytest.fixture
def caller(working: Settings) -> Iterator[httpx.Client]:
    with serving(working) as made:
        yield made


def enrol(caller: httpx.Client, **training: Any) -> tuple[str, str, str]:
    """Real frames are sent, and its training queued at once: ids of clip, capture and training."""
    person = {"name": "Ada", "height_m": HEIGHT_M}
    person_id = caller.post("/v1/people", json=person).json()["id"]
    files = {"file": ("frames.zip", seeds.real_frames())}
    sequence = caller.post(f"/v1/people/{person_id}/sequences", files=files).json()
    answer = caller.post(f"/v1/sequences/{sequence['id']}/models", json=training)
    assert answer.status_code == 202, answer.text
    return sequence["id"], sequence["job_id"], answer.json()["id"]


def has_model(job: dict[str, Any]) -> bool:
    return job["model_id"] is not None


def is_cancelled(job: dict[str, Any]) -> bool:
    return job["state"] == "cancelled"


def test_a_meeting_sees_a_first_likeness_while_the_clip_is_captured_and_then_the_model(
    caller: httpx.Client, working: Settings, tmp_path: Path
):
    sequence_id, capture_id, training_id = enrol(caller, budget_s=1.0)
    waiting = job_when(caller, training_id, has_model, "a first likeness")
    assert waiting["state"] == "queued"
    capture = caller.get(f"/v1/jobs/{capture_id}").json()
    assert (capture["state"], capture["has_preview"]) == ("running", True)
    likeness_id = waiting["model_id"]
    assert listed(caller) == [likeness_id]
    meeting = caller.post("/v1/meetings", json={"name": "Standup"}).json()
    performers = f"/v1/meetings/{meeting['id']}/performers"
    answer = caller.post(performers, json={"model_id": likeness_id})
    assert answer.status_code == 201, answer.text
    done = job_when(caller, training_id, lambda job: job["state"] == "succeeded", "the model")
    shown = caller.get(f"/v1/meetings/{meeting['id']}").json()["performers"]
    assert [one["model_id"] for one in shown] == listed(caller) == [done["model_id"]]
    assert done["model_id"] != likeness_id
    model = caller.get(f"/v1/models/{done['model_id']}").json()
    assert (model["metrics"]["round"], model["sequence_id"]) == (1, sequence_id)
    # clip, packed sequence, motion, thumbnail and three files of each model: nothing else is left
    # once the job's process has ended, a moment after its row
    until(lambda: len(stored_files(working)) == 10, "the end of all other files")
    sequence = caller.get(f"/v1/sequences/{sequence_id}").json()
    assert sequence["state"] == "ready"
    assert sequence["frames"] >= 8
    assert sequence["duration_s"] > 0.0
    assert sequence["quality"]
    thumbnail = caller.get(sequence["thumbnail_url"])
    assert thumbnail.content.startswith(b"\x89PNG")
    vertices = stored(working, sequence_id, tmp_path / "sequence").body.rest_vertices
    assert vertices is not None
    # they are as tall as they told
    assert np.ptp(vertices[:, 1]) == pytest.approx(HEIGHT_M, abs=0.01)


def stored(settings: Settings, sequence_id: str, folder: Path) -> Sequence:
    """What the capture of a clip left in the store."""
    services = build_services(settings)
    with services.reading() as unit:
        row = unit.sequences.get(sequence_id)
    assert row.packed_sha256 is not None
    unpack(services.objects, row.person_id, row.packed_sha256, folder)
    services.close()
    return open_sequence(folder)


def listed(caller: httpx.Client) -> list[str]:
    return [model["id"] for model in caller.get("/v1/models").json()["items"]]


def test_a_first_likeness_stays_whoever_dies_after_it(caller: httpx.Client, working: Settings):
    _, capture_id, training_id = enrol(caller, budget_s=4.5)
    likeness_id = job_when(caller, training_id, has_model, "a first likeness")["model_id"]
    os.kill(child_of(capture_id), signal.SIGKILL)
    captured = job_when(caller, capture_id, lambda job: job["state"] == "succeeded", "capturing")
    assert caller.get(f"/v1/jobs/{training_id}").json()["model_id"] == likeness_id
    assert captured["error"] is None
    job_when(caller, training_id, lambda job: job["progress"] > 0.0, "progress")
    os.kill(child_of(training_id), signal.SIGKILL)
    assert listed(caller) == [likeness_id]
    done = job_when(caller, training_id, lambda job: job["state"] == "succeeded", "the model")
    assert listed(caller) == [done["model_id"]] != [likeness_id]
    services = build_services(working)
    with services.reading() as unit:
        assert [unit.jobs.get(one).crashes for one in (capture_id, training_id)] == [1, 1]
    with services.database.engine.connect() as connection:
        made = connection.execute(select(ModelRow.metrics)).scalars().all()
    # superseded ones too: the likeness stands for the first round of two
    rounds = {metrics["round"]: metrics["train_seconds"] for metrics in made}
    assert rounds == {0: 3.0, 2: 4.5}
    services.close()


def test_a_cancelled_capture_leaves_no_likeness(caller: httpx.Client):
    for _ in range(_CLIPS):
        before = listed(caller)
        sequence_id, capture_id, training_id = enrol(caller, budget_s=60.0)
        job_when(caller, training_id, has_model, "a first likeness")
        if caller.delete(f"/v1/jobs/{capture_id}").status_code == 202:
            break
        # that capture was over before anybody had seen its likeness
        caller.delete(f"/v1/jobs/{training_id}")
        job_when(caller, training_id, is_cancelled, "the end")
    over = job_when(caller, training_id, is_cancelled, "the end")
    assert (over["model_id"], over["sequence_id"]) == (None, None)
    assert listed(caller) == before
    assert caller.get(f"/v1/sequences/{sequence_id}").status_code == 404


def waiting(services: Services, folder: Path, **params: Any) -> tuple[JobRow, str]:
    """A capture under way and the id of a training that waits for its clip."""
    sequence = seeds.captured(services, folder)
    with services.unit_of_work() as unit:
        clip = unit.sequences.get(sequence.id)
        clip.state = SequenceState.CAPTURING
        capture = enqueue(unit, JobKind.CAPTURE, clip, {}, services.clock())
        training = enqueue(unit, JobKind.TRAIN, clip, params, services.clock())
        capture.state, capture.attempt = JobState.RUNNING, 1
        unit.commit()
    return capture, training.id


@pytest.mark.parametrize("wanted", [{"preset": "fast"}, {"improves": "0" * 32}, {"seen": True}])
def test_no_likeness_is_made_that_nobody_waits_for(
    services: Services, sequence_folder: Path, wanted: dict[str, Any]
):
    params = {"preset": "splats", "budget_s": 1.0, "seed": 0, "improves": None} | wanted
    capture, training_id = waiting(services, sequence_folder, **params)
    if "seen" in wanted:  # an earlier attempt has made one
        with services.reading() as unit:
            clip = unit.sequences.get(str(capture.sequence_id))
        model = seeds.trained(services, clip)
        with services.unit_of_work() as unit:
            unit.jobs.get(training_id).model_id = model.id
            unit.commit()
    reporter = Reporter(services, JobLease(capture.id, capture.person_id, 1))
    make_first_likeness(services, capture, reporter, Path("nowhere"))


def test_a_capture_goes_on_where_no_likeness_is_found(
    services: Services, sequence_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    def diverge(*_: object, **__: object) -> None:
        raise TrainingError("training must stay finite; got a loss of nan")

    monkeypatch.setattr("services.jobs.first_likeness.train", diverge)
    params = {"preset": "splats", "budget_s": 1.0, "seed": 0, "improves": None}
    capture, training_id = waiting(services, sequence_folder, **params)
    reporter = Reporter(services, JobLease(capture.id, capture.person_id, 1))
    make_first_likeness(services, capture, reporter, sequence_folder)
    with services.reading() as unit:
        assert unit.jobs.get(training_id).model_id is None
