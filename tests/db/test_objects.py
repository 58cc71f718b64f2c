"""Bytes go in whole or not at all, come out as they went in, and orphans are swept."""

from __future__ import annotations

import hashlib
import os
import subprocess
import uuid
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from obstore.store import MemoryStore

from db.errors import NotFound, StoreAway, StoreFull
from db.objects import ObstoreObjects, fetch, open_objects
from db.sweep import sweep
from db.unit_of_work import Database
from tests.db.rows import full_life

OWNER = "0" * 32


def _files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


@pytest.fixture(params=["folder", "memory", pytest.param("s3", marks=pytest.mark.server)])
def any_store(request: pytest.FixtureRequest, tmp_path: Path) -> ObstoreObjects:
    if request.param == "s3":
        return open_objects(
            f"s3://test/{uuid.uuid4().hex}",
            endpoint=request.getfixturevalue("s3_endpoint"),
            access_key_id="a",
            secret_access_key="b",
        )
    if request.param == "memory":
        return ObstoreObjects(MemoryStore())
    return open_objects(f"file://{tmp_path}")


def test_bytes_come_out_as_they_went_in(any_store: ObstoreObjects):
    objects = any_store
    data = os.urandom(12_345_678)
    stored = objects.put(OWNER, (data[i : i + 70_000] for i in range(0, len(data), 70_000)))
    assert (stored.sha256, stored.bytes) == (hashlib.sha256(data).hexdigest(), len(data))
    assert b"".join(objects.stream(OWNER, stored.sha256)) == data
    assert [(i.sha256, i.bytes) for i in objects.list(OWNER)] == [(stored.sha256, len(data))]
    assert objects.owners() == [OWNER]
    assert objects.put(OWNER, [data]) == stored
    assert len(list(objects.list(OWNER))) == 1
    empty = objects.put(OWNER, [])
    assert b"".join(objects.stream(OWNER, empty.sha256)) == b""
    assert objects.delete_all(OWNER) == 2
    assert objects.owners() == []


def test_a_stream_that_breaks_leaves_nothing(objects: ObstoreObjects, tmp_path: Path):
    def broken() -> Iterator[bytes]:
        yield b"x" * 11_000_000
        raise ConnectionResetError("the other end has gone")

    with pytest.raises(ConnectionResetError):
        objects.put(OWNER, broken())
    assert _files(tmp_path / "objects") == []


def test_unknown_object_is_told_before_the_first_byte(objects: ObstoreObjects, tmp_path: Path):
    with pytest.raises(NotFound):
        objects.stream(OWNER, "f" * 64)
    with pytest.raises(NotFound):
        fetch(objects, OWNER, "f" * 64, tmp_path / "out")
    assert not list(tmp_path.glob("out*"))
    objects.delete(OWNER, "f" * 64)


def test_a_store_that_is_away_is_named_as_such():
    objects = open_objects(
        "s3://bucket/prefix",
        endpoint="http://127.0.0.1:1",
        access_key_id="a",
        secret_access_key="b",
    )
    with pytest.raises(StoreAway, match="the object store must answer"):
        objects.ping()
    with pytest.raises(StoreAway, match="must be file:///folder or s3://bucket/prefix"):
        open_objects("ftp://somewhere")


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "tiny"
    folder.mkdir()
    mount = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(folder)], capture_output=True
    )
    if mount.returncode != 0:
        pytest.skip(f"mounting a tiny disk needs root: {mount.stderr.decode().strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_told_and_leaves_nothing(tiny_disk: Path, objects: ObstoreObjects):
    tiny = open_objects(f"file://{tiny_disk}")
    with pytest.raises(StoreFull, match="needs free space"):
        tiny.put(OWNER, (b"x" * 100_000 for _ in range(100)))
    assert _files(tiny_disk) == []
    big = objects.put(OWNER, (b"x" * 100_000 for _ in range(100)))
    with pytest.raises(StoreFull, match="needs free space"):
        fetch(objects, OWNER, big.sha256, tiny_disk / "copy")
    assert _files(tiny_disk) == []


def test_sweeping_takes_old_orphans_and_nothing_else(
    database: Database, objects: ObstoreObjects, tmp_path: Path
):
    ada = full_life(database, objects)
    orphan = objects.put(ada, [b"nobody points at me"])
    stranger = objects.put("1" * 32, [b"nor is there such a person"])
    half = tmp_path / "objects" / "incoming" / "half"
    half.parent.mkdir(exist_ok=True)
    half.write_bytes(b"its writer died")
    now = datetime.now(UTC)
    young = sweep(database.unit_of_work, objects, now, upload_lifetime=timedelta(days=9999))
    assert (young.objects, young.incoming) == (0, 0)
    later = now + timedelta(days=1)
    old = sweep(database.unit_of_work, objects, later, upload_lifetime=timedelta(days=9999))
    assert (old.objects, old.incoming, old.uploads) == (2, 1, 0)
    kept = {info.sha256 for info in objects.list(ada)}
    assert len(kept) == 10
    assert orphan.sha256 not in kept
    assert list(objects.list("1" * 32)) == []
    assert stranger.bytes > 0
    assert not half.exists()


def test_an_upload_that_nobody_goes_on_with_is_swept(database: Database, objects: ObstoreObjects):
    ada = full_life(database, objects)
    much_later = datetime.now(UTC) + timedelta(days=3)
    swept = sweep(database.unit_of_work, objects, much_later)
    assert (swept.uploads, swept.objects) == (1, 1)
    assert len(list(objects.list(ada))) == 9
