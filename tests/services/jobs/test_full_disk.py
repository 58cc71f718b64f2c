"""A job that finds a disk full says so, leaves nothing half-written, and goes on by itself."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from benchmarks.faults.disks import TinyDisk
from db.errors import StoreFull
from db.objects import naming_errors
from services.composition import build_services
from services.problems import problem_of
from services.settings import Settings
from tests.services import seeds
from tests.services.conftest import changed, serving, stored_files
from tests.services.disks import tiny_disk
from tests.services.jobs.test_capturing import upload
from tests.services.jobs.waiting import job_when

PLENTY = 64_000_000
_OVER = ("succeeded", "failed")


@pytest.fixture
def working(settings: Settings) -> Settings:
    return changed(settings, embedded_worker=True)


@pytest.fixture
def disk(request: pytest.FixtureRequest, settings: Settings) -> Iterator[TinyDisk]:
    """Plenty of room at first, for what comes before the job."""
    folder = (
        settings.folders.data_dir / request.param if request.param else settings.folders.data_dir
    )
    made = tiny_disk(folder, PLENTY)
    yield made
    made.remove()


def _end(caller: httpx.Client, job_id: str) -> dict:
    return job_when(caller, job_id, lambda job: job["state"] in _OVER, "the end of the job")


def _waits(caller: httpx.Client, job_id: str) -> dict:
    """The job, as it waits for room and says so."""
    job = job_when(caller, job_id, lambda job: job["retry_at"] or job["state"] in _OVER, "the wait")
    assert job["state"] == "queued", job
    assert job["message"].startswith("waiting for room: the disk needs free space")
    assert job["error"]["type"] == "urn:metanerf:no-space-left"
    assert job["error"]["status"] == 507
    assert "the disk needs free space" in job["error"]["detail"]
    assert "free some and retry" in job["error"]["detail"]
    return job


@pytest.mark.parametrize(
    ("disk", "rooms_bytes"),
    [
        # not even the stored sequence fits; training begins, its files don't fit
        ("scratch", [20_000, 400_000]),
        ("objects", [0]),  # trained, but there is nowhere to keep the model
        ("", [150_000]),  # database, objects and scratch share one disk
    ],
    indirect=["disk"],
)
def test_a_training_says_what_is_full_and_goes_on_by_itself(
    working: Settings, disk: TinyDisk, sequence_folder: Path, rooms_bytes: list[int]
):
    services = build_services(working)
    services.database.migrate()
    sequence = seeds.captured(services, sequence_folder)
    services.close()
    before = set(stored_files(working))
    with serving(working) as caller:
        disk.leave(rooms_bytes[0])
        answer = caller.post(f"/v1/sequences/{sequence.id}/models", json={"budget_s": 0.2})
        job_id = answer.json()["id"]
        _waits(caller, job_id)
        assert set(stored_files(working)) == before
        for room_bytes in rooms_bytes[1:]:
            disk.leave(room_bytes)
            assert caller.post(f"/v1/jobs/{job_id}/resume").status_code == 202
            _waits(caller, job_id)
            assert set(stored_files(working)) == before
        disk.resize(PLENTY)
        mended = _end(caller, job_id)
        assert (mended["state"], mended["error"]) == ("succeeded", None)
        assert mended["retry_at"] is None
        assert caller.get(f"/v1/models/{mended['model_id']}").status_code == 200


@pytest.mark.parametrize("disk", ["scratch"], indirect=True)
def test_a_capture_keeps_the_clip_and_is_tried_at_once_on_request(
    working: Settings, disk: TinyDisk, pose_model: Path
):
    clip = seeds.real_frames()
    with serving(changed(working, pose_model=pose_model)) as caller:
        # uploads pass by the same disk: the clip comes while there is room
        uploaded = upload(caller, "frames.zip", clip)
        job_id = uploaded["job_id"]
        disk.leave(500_000)  # the clip fits, the sequence that is made of it does not
        first = _waits(caller, job_id)
        assert caller.get(f"/v1/sequences/{uploaded['id']}").json()["state"] == "uploaded"
        disk.leave(20_000)  # not even the clip
        assert caller.post(f"/v1/jobs/{job_id}/resume").status_code == 202
        job_when(caller, job_id, lambda job: job["retry_at"] != first["retry_at"], "a try")
        _waits(caller, job_id)
        assert [path.name for path in stored_files(working)] == [uploaded["sha256"]]
        disk.resize(PLENTY)
        path = f"/v1/people/{uploaded['person_id']}/sequences"
        known = caller.post(path, files={"file": ("frames.zip", clip)}).json()
        assert (known["id"], known["job_id"]) == (uploaded["id"], job_id)
        assert _end(caller, job_id)["state"] == "succeeded"
        assert caller.get(f"/v1/sequences/{uploaded['id']}").json()["state"] == "ready"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_every_kind_of_full_is_told(number: int):
    full = OSError(number, "in the system's words")
    with pytest.raises(StoreFull, match="free some and retry"), naming_errors():
        raise full
    wrapped = ValueError("the archive could not be closed")
    wrapped.__context__ = full
    for error in (full, wrapped, RuntimeError(f"I/O error: it is full (os error {number})")):
        assert problem_of(error).status == 507
    assert problem_of(OSError(errno.EACCES, "no")).status == 500
