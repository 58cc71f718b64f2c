"""Uploads that end badly on a real server: a cut line, a killed server, a full disk."""

from __future__ import annotations

import hashlib
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from services.composition import build_services
from services.jobs.scratch import clear_abandoned, scratch_folder
from services.settings import Settings
from tests.services import disks, seeds
from tests.services.conftest import bearer, serving, stored_files
from tests.services.jobs.waiting import until


def _half_a_request(caller: httpx.Client, method: str, path: str, headers: dict, body: bytes):
    """A connection on which `body` was sent of a request that announces ten times as much."""
    address = (caller.base_url.host, caller.base_url.port)
    line = socket.create_connection(address)
    sent = {
        "Host": "test",
        "Authorization": caller.headers["authorization"],
        "Content-Length": str(10 * len(body)),
        **headers,
    }
    head = "".join(f"{name}: {value}\r\n" for name, value in sent.items())
    line.sendall(f"{method} {path} HTTP/1.1\r\n{head}\r\n".encode() + body)
    return line


def _form(data: bytes) -> tuple[dict, bytes]:
    body = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.mp4"\r\n\r\n' + data
    return {"Content-Type": "multipart/form-data; boundary=x"}, body


def test_a_cut_line_leaves_nothing(settings: Settings):
    with serving(settings) as caller:
        person_id = caller.post("/v1/people", json={"name": "Ada"}).json()["id"]
        headers, body = _form(os.urandom(1_500_000))
        line = _half_a_request(caller, "POST", f"/v1/people/{person_id}/sequences", headers, body)
        until(lambda: stored_files(settings), "receiving")
        line.close()
        until(lambda: not stored_files(settings), "clearing up")
        assert caller.get(f"/v1/people/{person_id}").json()["sequences"] == []
    assert list(settings.folders.scratch_dir.iterdir()) == []


def test_a_cut_piece_is_gone_on_with(settings: Settings):
    data = seeds.archive({f"{i:02d}.png": seeds.picture(i, size=256) for i in range(40)})
    with serving(settings) as caller:
        person_id = caller.post("/v1/people", json={"name": "Ada"}).json()["id"]
        begin = {
            "filename": "a.zip",
            "size": len(data),
            "sha256": hashlib.sha256(data).hexdigest(),
        }
        begun = caller.post(f"/v1/people/{person_id}/uploads", json=begin).json()
        path = f"/v1/uploads/{begun['id']}"
        cut = 3_000_000
        line = _half_a_request(caller, "PATCH", path, {"Upload-Offset": "0"}, data[:cut])
        until(lambda: stored_files(settings), "receiving")
        line.close()
        offset = until(lambda: int(caller.head(path).headers["upload-offset"]), "keeping the piece")
        assert 0 < offset <= cut
        last = caller.patch(path, content=data[offset:], headers={"Upload-Offset": str(offset)})
        assert last.status_code == 202, last.text
        assert last.json()["sha256"] == begin["sha256"]


def test_a_killed_server_leaves_nothing_visible_and_its_scratch_is_cleared(settings: Settings):
    code = (
        "import sys, uvicorn; from services.app import create_app; "
        "from services.composition import build_services; "
        "from services.settings import load_settings; "
        "app = create_app(build_services(load_settings())); "
        "uvicorn.run(app, port=int(sys.argv[1]), log_level='warning')"
    )
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-c", code, str(port)], env=settings.child_environment()
    )
    services = build_services(settings)
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", headers=bearer(services)) as caller:
        until(lambda: _answers(caller), "starting")
        person_id = caller.post("/v1/people", json={"name": "Ada"}).json()["id"]
        headers, body = _form(os.urandom(1_500_000))
        line = _half_a_request(caller, "POST", f"/v1/people/{person_id}/sequences", headers, body)
        until(lambda: stored_files(settings), "receiving")
        server.kill()
        server.wait()
        line.close()
    with services.reading() as unit:
        assert unit.sequences.of_person(person_id) == []
    assert list(services.objects.list(person_id)) == []
    with scratch_folder(settings.folders.scratch_dir) as mine:
        clear_abandoned(settings.folders.scratch_dir)
        assert list(settings.folders.scratch_dir.iterdir()) == [mine]
    services.close()


@pytest.fixture
def tiny_disk(settings: Settings) -> Iterator[Path]:
    """2 MB of scratch space."""
    disk = disks.tiny_disk(settings.folders.scratch_dir, 2_000_000)
    yield disk.folder
    disk.remove()


def test_a_full_disk_is_told_and_leaves_nothing(settings: Settings, tiny_disk: Path):
    with serving(settings) as caller:
        person_id = caller.post("/v1/people", json={"name": "Ada"}).json()["id"]
        answer = caller.post(
            f"/v1/people/{person_id}/sequences", files={"file": ("a.mp4", os.urandom(8_000_000))}
        )
        assert answer.status_code == 507, answer.text
        assert answer.headers["content-type"] == "application/problem+json"
        assert "free some" in answer.json()["detail"]
        assert stored_files(settings) == []
        assert caller.get(f"/v1/people/{person_id}").json()["sequences"] == []
    assert list(tiny_disk.iterdir()) == []


def _answers(caller: httpx.Client) -> bool:
    try:
        return caller.get("/healthz").status_code == 200
    except httpx.TransportError:
        return False
