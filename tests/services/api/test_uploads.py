"""Uploads: what is good is stored once; what is bad is told and leaves no trace."""

from __future__ import annotations

import asyncio
import hashlib
import json
import sys
import zipfile
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest

from db.errors import StoreFull
from services.app import create_app
from services.composition import build_services
from services.container import Services
from services.gateway import gateway_of
from services.jobs.queue import fail
from services.problems import stored_failure
from services.settings import Settings
from services.uploads import turns
from tests.fakes import SmallObjects
from tests.services import seeds
from tests.services.conftest import bearer, stored_files

NAN_POSE = json.dumps(seeds.keypoints(angle=float("nan")))
BAD = {
    "a text named mp4": ("clip.mp4", b"this is no film\n" * 99, "got a text file; choose"),
    "a picture named mp4": ("clip.mp4", seeds.picture(), "got a file of another kind; choose"),
    "nothing at all": ("clip.mp4", b"", "'clip.mp4' must be a video (mp4, mov, webm, mkv)"),
    "a broken mp4": ("clip.mp4", b"\0\0\0\x18ftypisom" + b"\0" * 500, "clip.mp4 must"),
    "a path outside": (
        "frames.zip",
        seeds.archive({"../../etc/passwd.png": seeds.picture()}),
        "must stay inside the archive; got '../../etc/passwd.png'",
    ),
    "a zip bomb": (
        "frames.zip",
        seeds.archive({"0.png": b"\0" * 20_000_000}),
        "must grow at most 200 times",
    ),
    "an empty frame": (
        "frames.zip",
        seeds.archive({f"{i}.png": seeds.picture(i) for i in range(40)} | {"17.png": b""}),
        "17.png must be a picture; got 0 bytes",
    ),
    "a zip without pictures": ("frames.zip", seeds.archive({"a.txt": b"hi"}), "must hold pictures"),
    "half a zip": ("frames.zip", seeds.frames_archive()[:2000], "frames.zip must be"),
    "an encrypted-looking zip": (
        "frames.zip",
        seeds.archive({"0.png": b"no picture"}, zipfile.ZIP_STORED),
        "0.png must be a picture",
    ),
    "keypoints with NaN": ("pose.json", NAN_POSE.encode(), "finite"),
    "another json": ("pose.json", b'{"hello": 1}', "format"),
}


async def _post(client: httpx.AsyncClient, person_id: str, name: str, data: bytes):
    return await client.post(
        f"/v1/people/{person_id}/sequences", files={"file": (name, data)}, timeout=60
    )


@pytest.mark.parametrize(("name", "data", "told"), BAD.values(), ids=BAD.keys())
async def test_bad_uploads_are_told_and_leave_nothing(
    client: httpx.AsyncClient,
    services: Services,
    person_id: str,
    name: str,
    data: bytes,
    told: str,
):
    answer = await _post(client, person_id, name, data)
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert told in answer.json()["detail"]
    assert str(services.settings.folders.data_dir) not in answer.text
    assert stored_files(services.settings) == []
    assert (await client.get(f"/v1/people/{person_id}")).json()["sequences"] == []


async def test_a_video_is_stored_and_its_capture_queued(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    data = seeds.video()
    answer = await _post(client, person_id, "C:\\films\\me.mp4", data)
    assert answer.status_code == 202
    sequence = answer.json()
    assert (sequence["kind"], sequence["state"]) == ("video", "uploaded")
    assert sequence["sha256"] == hashlib.sha256(data).hexdigest()
    assert sequence["thumbnail_url"] is None
    job = (await client.get(f"/v1/jobs/{sequence['job_id']}")).json()
    assert (job["kind"], job["state"], job["sequence_id"]) == ("capture", "queued", sequence["id"])
    assert [p.name for p in stored_files(services.settings)] == [sequence["sha256"]]
    again = await _post(client, person_id, "other-name.mp4", data)
    assert again.json()["id"] == sequence["id"]
    assert len(stored_files(services.settings)) == 1
    assert (await client.get(f"/v1/people/{person_id}")).json()["sequences"] == [sequence]


async def test_the_kind_is_told_by_the_bytes(client: httpx.AsyncClient, person_id: str):
    frames = await _post(client, person_id, "clip.mp4", seeds.frames_archive())
    assert frames.json()["kind"] == "frames"


async def test_cancelling_a_capture_that_waits_leaves_only_the_job(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    sequence = (await _post(client, person_id, "a.mp4", seeds.video())).json()
    cancelled = await client.delete(f"/v1/jobs/{sequence['job_id']}")
    assert cancelled.status_code == 202
    assert cancelled.json()["state"] == "cancelled"
    assert (await client.get(f"/v1/sequences/{sequence['id']}")).status_code == 404
    assert stored_files(services.settings) == []
    assert (await client.delete(f"/v1/jobs/{sequence['job_id']}")).status_code == 409
    assert (await client.post(f"/v1/jobs/{sequence['job_id']}/resume")).status_code == 409


async def test_keypoints_are_ready_at_once_and_train_nothing(
    client: httpx.AsyncClient, person_id: str
):
    answer = await _post(client, person_id, "wave.json", json.dumps(seeds.keypoints(5)).encode())
    assert answer.status_code == 202, answer.text
    sequence = answer.json()
    assert (sequence["kind"], sequence["state"], sequence["frames"]) == ("keypoints", "ready", 5)
    assert sequence["job_id"] is None
    refused = await client.post(f"/v1/sequences/{sequence['id']}/models", json={})
    assert refused.status_code == 422
    assert "keypoints alone" in refused.json()["detail"]


async def test_a_training_waits_for_the_capture_and_ends_with_it(
    client: httpx.AsyncClient, person_id: str
):
    sequence = (await _post(client, person_id, "a.mp4", seeds.video())).json()
    early = await client.post(f"/v1/sequences/{sequence['id']}/models", json={})
    assert early.status_code == 202
    waiting = early.json()
    assert (waiting["state"], waiting["message"]) == ("queued", "waiting for the capture")
    await client.delete(f"/v1/jobs/{sequence['job_id']}")
    over = (await client.get(f"/v1/jobs/{waiting['id']}")).json()
    assert (over["state"], over["sequence_id"]) == ("cancelled", None)
    assert (await client.post(f"/v1/jobs/{waiting['id']}/resume")).status_code == 409


async def test_no_training_waits_for_a_capture_that_has_stopped(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    sequence = (await _post(client, person_id, "a.mp4", seeds.video())).json()
    with services.unit_of_work() as unit:
        capture = unit.jobs.get(sequence["job_id"])
        fail(unit, capture, StoreFull("the disk is full"), services.clock(), stored_failure)
        unit.commit()
    refused = await client.post(f"/v1/sequences/{sequence['id']}/models", json={})
    assert refused.status_code == 409
    assert "resume its capture" in refused.json()["detail"]


async def test_too_large_is_told_before_it_is_read(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    limit = services.settings.uploads.max_bytes
    declared = await client.post(
        f"/v1/people/{person_id}/sequences",
        content=b"--x",
        headers={
            "Content-Type": "multipart/form-data; boundary=x",
            "Content-Length": str(limit * 2),
        },
    )
    assert declared.status_code == 413
    assert f"at most {limit} bytes" in declared.json()["detail"]
    begun = await client.post(
        f"/v1/people/{person_id}/uploads",
        json={"filename": "a.mp4", "size": limit + 1, "sha256": "0" * 64},
    )
    assert begun.status_code == 413


async def test_too_large_without_a_declared_length_is_cut_off(
    client: httpx.AsyncClient, services: Services, person_id: str
):
    sent = 0

    async def endless() -> AsyncIterator[bytes]:
        nonlocal sent
        yield b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.mp4"\r\n\r\n'
        while sent < 200_000_000:
            sent += 1_000_000
            yield b"\0" * 1_000_000

    answer = await client.post(
        f"/v1/people/{person_id}/sequences",
        content=endless(),
        headers={"Content-Type": "multipart/form-data; boundary=x"},
    )
    assert answer.status_code == 413
    assert sent < 2 * services.settings.uploads.max_bytes
    assert stored_files(services.settings) == []


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"hello", "text/plain"),
        (b"hello", "multipart/form-data; boundary=x"),
        (
            b'--x\r\nContent-Disposition: form-data; name="other"\r\n\r\nhi\r\n--x--\r\n',
            "multipart/form-data; boundary=x",
        ),
        (
            b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\nhalf',
            "multipart/form-data; boundary=x",
        ),
    ],
)
async def test_another_body_is_told_what_is_wanted(
    client: httpx.AsyncClient, services: Services, person_id: str, content: bytes, kind: str
):
    answer = await client.post(
        f"/v1/people/{person_id}/sequences", content=content, headers={"Content-Type": kind}
    )
    assert answer.status_code == 422
    assert "curl -F file=@clip.mp4" in answer.json()["detail"]
    assert stored_files(services.settings) == []


async def test_unknown_person_is_told_before_the_bytes_are_read(client: httpx.AsyncClient):
    assert (await _post(client, "nobody", "a.mp4", b"x")).status_code == 404


async def test_a_full_store_is_told_and_leaves_nothing(settings: Settings):
    small = SmallObjects(settings.folders.data_dir / "objects", capacity=10_000)
    services = build_services(settings, objects=small)
    services.database.migrate()
    transport = httpx.ASGITransport(create_app(services), raise_app_exceptions=False)
    async with httpx.AsyncClient(
        transport=transport, base_url="http://test", headers=bearer(services)
    ) as client:
        person_id = (await client.post("/v1/people", json={"name": "Ada"})).json()["id"]
        answer = await _post(client, person_id, "a.mp4", seeds.video(40))
        assert answer.status_code == 507
        assert "needs free space" in answer.json()["detail"]
        assert stored_files(settings) == []
        assert (await client.get(f"/v1/people/{person_id}")).json()["sequences"] == []
    services.close()


@pytest.fixture
def counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where each process that looks leaves a file while it does; none ends before `go` is there."""
    folder = tmp_path / "looks"
    folder.mkdir()
    program = tmp_path / "looks-at"
    program.write_text(
        "#!/bin/sh\n"
        f"touch {folder}/$$\n"
        f"while [ ! -e {folder}/go ]; do sleep 0.05; done\n"
        f"rm {folder}/$$\n"
        """echo '{"kind": "frames"}'\n"""
    )
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    return folder


async def test_few_clips_are_looked_at_at_once_and_nobody_else_waits(
    services: Services, counted: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(turns, "MOST_OF_ONE_WAITING", 6)
    app = create_app(services)
    client = httpx.AsyncClient(
        transport=httpx.ASGITransport(app), base_url="http://test", headers=bearer(services)
    )
    person_id = (await client.post("/v1/people", json={"name": "Ada"})).json()["id"]
    clips = [seeds.frames_archive() + bytes(number) for number in range(9)]
    sending = [
        asyncio.create_task(_post(client, person_id, "frames.zip", clip)) for clip in clips[:8]
    ]
    async with asyncio.timeout(20):
        while gateway_of(app).turns.waiting < 6 or not list(counted.iterdir()):
            await asyncio.sleep(0.02)
    # requests go on, and what would be too much is told when to come again
    assert (await client.get("/v1/people")).status_code == 200
    full = await _post(client, person_id, "frames.zip", clips[8])
    assert (full.status_code, full.headers["retry-after"]) == (503, "10")
    await asyncio.sleep(0.5)  # as long as a third would take to start
    assert len(list(counted.iterdir())) == turns.AT_ONCE
    (counted / "go").touch()
    assert [(await one).status_code for one in sending] == 8 * [202]
    assert (await _post(client, person_id, "frames.zip", clips[8])).status_code == 202
    await client.aclose()
