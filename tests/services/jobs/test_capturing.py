"""Captures by a real gateway and landmark model: nobody, and a change of mind.

How a person is captured is seen on the way to a first likeness (test_first_likeness).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import httpx
import pytest

from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import SECRET, changed, serving, stored_files
from tests.services.jobs.waiting import child_of, job_when, until


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


def process_of(module: str, job_id: str) -> Path:
    """The folder in /proc of the child of a job's process that runs `module`."""
    parent = str(child_of(job_id))

    def look() -> Path | None:
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                is_child = (folder / "stat").read_text().rpartition(")")[2].split()[1] == parent
                if is_child and module.encode() in (folder / "cmdline").read_bytes():
                    return folder
        return None

    return until(look, f"a process of {module}")


def has_no_network(process: Path) -> bool:
    """Whether a process is where there is none; True where the system doesn't let it go there."""
    if os.geteuid() != 0:
        return True
    return (process / "ns/net").readlink() != Path("/proc/self/ns/net").readlink()


def test_a_running_capture_has_no_secret_and_no_network_and_can_be_cancelled(
    caller: httpx.Client, settings: Settings
):
    uploaded = upload(caller, "frames.zip", seeds.real_frames())
    job_when(caller, uploaded["job_id"], lambda job: job["state"] == "running", "starting")
    confined = process_of("services.jobs.confined_capture", uploaded["job_id"])
    told = (confined / "environ").read_bytes().decode()
    assert "NUMBA_CACHE_DIR=" in told
    assert SECRET not in told
    assert not [one for one in told.split("\0") if one.startswith(("METANERF_", "AWS_"))]
    until(lambda: has_no_network(confined), "leaving the network")
    caller.delete(f"/v1/jobs/{uploaded['job_id']}")
    job_when(caller, uploaded["job_id"], lambda job: job["state"] == "cancelled", "the end")
    assert caller.get(f"/v1/sequences/{uploaded['id']}").status_code == 404
    until(lambda: stored_files(settings) == [], "deleting what was uploaded")
