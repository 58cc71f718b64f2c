"""Training by a real gateway in real child processes: followed, stopped, killed, resumed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from services.composition import build_services
from services.jobs.train_job import round_ends
from services.settings import Settings
from tests.servers import DATABASES, fresh_database
from tests.services import seeds
from tests.services.conftest import changed, serving, stored_files
from tests.services.jobs.waiting import child_of, job_when, until


@pytest.fixture
def working(
    request: pytest.FixtureRequest, settings: Settings, tmp_path: Path
) -> Iterator[Settings]:
    """Settings of a gateway that runs jobs; with PostgreSQL goes Redis, as when deployed."""
    kind = getattr(request, "param", "sqlite")
    with fresh_database(kind, tmp_path) as url:
        events = request.getfixturevalue("redis_url") if kind == "postgresql" else None
        changes = {"database_url": url, "redis_url": events, "embedded_worker": True}
        yield changed(settings, **changes)


@pytest.fixture
def sequence_id(working: Settings, sequence_folder: Path) -> str:
    services = build_services(working)
    services.database.migrate()
    sequence = seeds.captured(services, sequence_folder)
    services.close()
    return sequence.id


def _start(caller: httpx.Client, sequence_id: str, budget_s: float) -> str:
    answer = caller.post(f"/v1/sequences/{sequence_id}/models", json={"budget_s": budget_s})
    assert answer.status_code == 202, answer.text
    assert answer.json()["state"] == "queued"
    return answer.json()["id"]


def _follow(caller: httpx.Client, job_id: str) -> list[tuple[str, dict]]:
    events = []
    with caller.stream("GET", f"/v1/jobs/{job_id}/events") as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        name = ""
        for line in stream.iter_lines():
            if line.startswith("event: "):
                name = line.removeprefix("event: ")
            elif line.startswith("data: "):
                events.append((name, json.loads(line.removeprefix("data: "))))
    return events


def _follow_to_model(caller: httpx.Client, job_id: str) -> dict:
    """The job as it is told last, after progress that only grew."""
    events = _follow(caller, job_id)
    names = [name for name, _ in events]
    assert names == ["progress"] * (len(events) - 1) + ["end"]
    shares = [job["progress"] for _, job in events]
    assert shares == sorted(shares)
    assert any(0.0 < share < 1.0 for share in shares)
    last = events[-1][1]
    assert (last["state"], last["progress"], last["error"]) == ("succeeded", 1.0, None)
    return last


@pytest.mark.parametrize("working", DATABASES, indirect=True)
def test_a_training_is_followed_to_its_model(working: Settings, sequence_id: str):
    with serving(working) as caller:
        job_id = _start(caller, sequence_id, budget_s=1.0)
        last = _follow_to_model(caller, job_id)
        preview = caller.get(f"/v1/jobs/{job_id}/preview")
        assert preview.content.startswith(b"\x89PNG")
        model = caller.get(f"/v1/models/{last['model_id']}").json()
        assert (model["preset"], model["sequence_id"]) == ("splats", sequence_id)
        view = caller.post(f"/v1/models/{model['id']}/views", json={"width": 64, "height": 64})
        assert view.content.startswith(b"\x89PNG")
        refused = caller.delete(f"/v1/jobs/{job_id}")
        assert refused.status_code == 409
    left = {path.name for path in stored_files(working)}
    assert model["sha256"] in left
    # clip, packed sequence, motion, weights, splats twice: no checkpoint, no scratch
    assert len(left) == 6


def test_a_meeting_sees_the_first_model_in_seconds_and_better_ones_take_its_place(
    working: Settings, sequence_id: str
):
    with serving(working) as caller:
        job_id = _start(caller, sequence_id, budget_s=4.5)
        early = job_when(caller, job_id, lambda job: job["model_id"] is not None, "a first model")
        assert early["state"] == "running"
        opened = caller.post("/v1/meetings", json={"name": "Standup"}).json()
        performer = {"model_id": early["model_id"]}
        answer = caller.post(f"/v1/meetings/{opened['id']}/performers", json=performer)
        assert answer.status_code == 201, answer.text
        last = _follow_to_model(caller, job_id)
        assert last["model_id"] != early["model_id"]

        def shown() -> list[str]:
            meeting = caller.get(f"/v1/meetings/{opened['id']}").json()
            return [one["model_id"] for one in meeting["performers"]]

        def listed() -> list[str]:
            return [model["id"] for model in caller.get("/v1/models").json()["items"]]

        assert shown() == listed() == [last["model_id"]]
        # who looks at the first one still may
        view = {"width": 64, "height": 64}
        assert caller.post(f"/v1/models/{early['model_id']}/views", json=view).status_code == 200
        wanted = {"budget_s": 0.2, "improves": last["model_id"]}
        again = caller.post(f"/v1/sequences/{sequence_id}/models", json=wanted)
        assert again.status_code == 202, again.text
        better = _follow(caller, again.json()["id"])[-1][1]["model_id"]
        assert shown() == listed() == [better]
        assert better != last["model_id"]


def test_only_splats_of_the_same_person_are_gone_on_from(
    settings: Settings, model_file: Path, sequence_folder: Path
):
    services = build_services(settings)
    services.database.migrate()
    model = seeds.with_clip(services, model_file, sequence_folder)
    with services.reading() as unit:
        sequence_id = unit.models.get(model.id).sequence_id
    services.close()
    with serving(settings) as caller:
        wanted = {"budget_s": 1.0, "improves": model.id, "preset": "fast"}
        refused = caller.post(f"/v1/sequences/{sequence_id}/models", json=wanted)
        assert refused.status_code == 422
        assert "must be a model of splats" in refused.json()["detail"]
        wanted = {"budget_s": 1.0, "improves": "0" * 32}
        unknown = caller.post(f"/v1/sequences/{sequence_id}/models", json=wanted)
        assert unknown.status_code == 404


def test_rounds_end_where_another_version_is_worth_it():
    assert round_ends("splats", 2.0) == [2.0]
    assert round_ends("splats", 4.0) == [4.0]
    assert round_ends("splats", 20.0) == [3.0, 12.0, 20.0]
    assert round_ends("splats", 60.0) == [3.0, 12.0, 60.0]
    assert round_ends("fast", 60.0) == [60.0]


def test_a_stopped_or_killed_training_goes_on_from_its_checkpoint(
    working: Settings, sequence_id: str
):
    with serving(working) as caller:
        job_id = _start(caller, sequence_id, budget_s=60.0)
        job_when(caller, job_id, lambda job: job["progress"] > 0.03, "progress")
    # the gateway has stopped: its job waits, with a checkpoint
    services = build_services(working)
    with services.reading() as unit:
        stopped = unit.jobs.get(job_id)
    assert (stopped.state, stopped.crashes) == ("queued", 0)
    assert stopped.checkpoint_sha256 is not None
    with serving(working) as caller:
        first = child_of(job_id)
        resumed = job_when(
            caller,
            job_id,
            lambda job: job["message"].startswith("learning ") and job["state"] == "running",
            "going on after a restart",
        )
        assert resumed["progress"] >= stopped.progress - 0.01
        os.kill(first, signal.SIGKILL)
        second = until(lambda: (pid := child_of(job_id)) != first and pid, "another process")
        assert second != first
        again = job_when(
            caller,
            job_id,
            lambda job: job["message"].startswith("learning "),
            "going on after a crash",
        )
        assert again["progress"] >= stopped.progress - 0.01
        with services.reading() as unit:
            job = unit.jobs.get(job_id)
            assert (job.crashes, job.attempt) == (1, 3)
        assert caller.delete(f"/v1/jobs/{job_id}").status_code == 202
        cancelled = job_when(caller, job_id, lambda job: job["state"] == "cancelled", "the end")
        assert cancelled["message"] == "cancelled"
        assert _follow(caller, job_id)[-1][0] == "end"
        assert caller.post(f"/v1/jobs/{job_id}/resume").json()["state"] == "queued"
        job_when(caller, job_id, lambda job: job["state"] == "running", "resuming")
        person_id = caller.get(f"/v1/sequences/{sequence_id}").json()["person_id"]
        third = child_of(job_id)
        assert caller.delete(f"/v1/people/{person_id}").json()["remaining"] == 0
        until(lambda: not Path(f"/proc/{third}/cwd").exists(), "the end of an erased job's process")
    services.close()
    assert stored_files(working) == []


def test_a_worker_that_is_killed_takes_no_job_with_it(working: Settings, sequence_id: str):
    services = build_services(working)
    with services.reading() as unit:
        sequence = unit.sequences.get(sequence_id)
    job_id = seeds.queued_training(services, sequence, budget_s=60.0)
    worker = subprocess.Popen(
        [sys.executable, "-c", "from services.cli import main; main()", "worker", "train"],
        env=working.child_environment(),
    )

    def state(wanted: str):
        def look():
            with services.reading() as unit:
                job = unit.jobs.get(job_id)
            return job if job.state == wanted and job.progress > 0.0 else None

        return look

    try:
        until(state("running"), "progress")
    finally:
        worker.kill()
        worker.wait()
    given_back = until(state("queued"), "giving the job back")
    assert given_back.checkpoint_sha256 is not None
    services.close()
