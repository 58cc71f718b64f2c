"""Captures by a real gateway and landmark model: a person, nobody, and a change of mind."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from capture.storage import open_sequence
from scene.sequence import Sequence
from services.composition import build_services
from services.jobs.packing import unpack
from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import changed, serving, stored_files
from tests.services.jobs.waiting import job_when, until


@pytest.fixture
def caller(settings: Settings, pose_model: Path) -> Iterator[httpx.Client]:
    changes = {"embedded_worker": True, "pose_model": pose_model}
    with serving(changed(settings, **changes)) as made:
        yield made


def upload(caller: httpx.Client, name: str, data: bytes, **person: float) -> dict:
    person_id = caller.post("/v1/people", json={"name": "Ada", **person}).json()["id"]
    answer = caller.post(f"/v1/people/{person_id}/sequences", files={"file": (name, data)})
    assert answer.status_code == 202, answer.text
    return answer.json()


def test_real_frames_become_a_sequence_of_somebody_as_tall_as_they_told(
    caller: httpx.Client, settings: Settings, tmp_path: Path
):
    uploaded = upload(caller, "frames.zip", seeds.real_frames(), height_m=1.9)
    job = job_when(
        caller,
        uploaded["job_id"],
        lambda job: job["state"] in ("succeeded", "failed"),
        "the end of the capture",
    )
    assert job["state"] == "succeeded", job
    sequence = caller.get(f"/v1/sequences/{uploaded['id']}").json()
    assert sequence["state"] == "ready"
    assert sequence["frames"] >= 8
    assert sequence["duration_s"] > 0.0
    assert sequence["quality"]
    thumbnail = caller.get(sequence["thumbnail_url"])
    assert thumbnail.content.startswith(b"\x89PNG")
    vertices = stored(settings, uploaded["id"], tmp_path / "sequence").body.rest_vertices
    assert vertices is not None
    assert np.ptp(vertices[:, 1]) == pytest.approx(1.9, abs=0.01)


def stored(settings: Settings, sequence_id: str, folder: Path) -> Sequence:
    """What the capture of a clip left in the store."""
    services = build_services(settings)
    with services.reading() as unit:
        row = unit.sequences.get(sequence_id)
    assert row.packed_sha256 is not None
    unpack(services.objects, row.person_id, row.packed_sha256, folder)
    services.close()
    return open_sequence(folder)


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
