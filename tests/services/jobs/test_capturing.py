"""Captures by a real gateway and landmark model: nobody, and a change of mind.

How a person is captured is seen on the way to a first likeness (test_first_likeness).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import changed, serving, stored_files
from tests.services.jobs.waiting import job_when, until


@pytest.fixture
def caller(settings: Settings, pose_model: Path) -> Iterator[httpx.Client]:
    changes = {"embedded_worker": True, "pose_model": pose_model}
    with serving(changed(settings, **changes)) as made:
        yield made


def upload(caller: httpx.Client, name: str, data: bytes) -> dict:
    person_id = caller.post("/v1/people", json={"name": "Ada"}).json()["id"]
    answer = caller.post(f"/v1/people/{person_id}/sequences", files={"file": (name, data)})
    assert answer.status_code == 202, answer.text
    return answer.json()


def test_a_video_without_a_person_fails_with_the_reason_and_leaves_nothing(
    caller: httpx.Client, settings: Settings
):
    uploaded = upload(caller, "noise.mp4", seeds.video(16))
    job = job_when(caller, uploaded["job_id"], lambda job: job["state"] == "failed", "failing")
    assert job["error"]["status"] == 422
    assert "person" in job["error"]["detail"]
    assert job["sequence_id"] is None
    assert caller.get(f"/v1/sequences/{uploaded['id']}").status_code == 404
    assert caller.post(f"/v1/jobs/{job['id']}/resume").status_code == 409
    until(lambda: stored_files(settings) == [], "deleting what was uploaded")


def test_a_running_capture_can_be_cancelled(caller: httpx.Client, settings: Settings):
    uploaded = upload(caller, "frames.zip", seeds.real_frames())
    job_when(caller, uploaded["job_id"], lambda job: job["state"] == "running", "starting")
    caller.delete(f"/v1/jobs/{uploaded['job_id']}")
    job_when(caller, uploaded["job_id"], lambda job: job["state"] == "cancelled", "the end")
    assert caller.get(f"/v1/sequences/{uploaded['id']}").status_code == 404
    until(lambda: stored_files(settings) == [], "deleting what was uploaded")
