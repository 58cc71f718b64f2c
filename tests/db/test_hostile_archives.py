"""Whatever an archive holds, it comes back whole or is refused, and then nothing has changed."""

from __future__ import annotations

import hashlib
import io
import json
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import delete, func, select

from db.archive import Manifest, decode_row
from db.encrypted_file import DecryptingReader, EncryptingWriter
from db.errors import BrokenArchive, DatabaseError
from db.migrations.runner import head
from db.models import Base
from db.objects import open_objects
from db.restore import restore
from db.unit_of_work import Database
from scene.errors import SceneError
from tests import few_examples
from tests.db.rows import NOW

FEW = settings(few_examples.FEW, max_examples=120)
FEWER = settings(FEW, max_examples=30)
"""Each asks a database."""
SECRET = b"a secret for tests only, long enough"
_PERSON = {
    "id": "a" * 32,
    "account": "house",
    "name": "Ada",
    "created_at": {"time": "2026-01-01T12:00:00+00:00"},
}


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Database]:
    made = Database(f"sqlite:///{tmp_path_factory.mktemp('db') / 'empty.db'}")
    made.migrate()
    yield made
    made.close()


def _tar(entries: dict[str, bytes]) -> bytes:
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as made:
        for name, data in entries.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            made.addfile(entry, io.BytesIO(data))
    return file.getvalue()


def _archive(entries: dict[str, bytes], **changes: Any) -> bytes:
    """With a manifest that names all of it, but for `changes`."""
    tables = {n: d for n, d in entries.items() if n.startswith("rows/")}
    objects = [d for n, d in entries.items() if n.startswith("objects/")]
    manifest = Manifest(
        revision=head(),
        made_at=NOW.isoformat(),
        forget_by=(NOW + timedelta(days=30)).isoformat(),
        rows={},
        hashes={
            n[5:].removesuffix(".jsonl"): hashlib.sha256(d).hexdigest() for n, d in tables.items()
        },
        objects=len(objects),
        bytes=sum(map(len, objects)),
        lost=(),
    )
    about = json.loads(manifest.to_json()) | changes
    return _tar(entries | {"manifest.json": json.dumps(about).encode()})


def _restored(database: Database, data: bytes) -> bool:
    """Whether an archive was taken; what was not has left nothing, in either place."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "all.tar"
        path.write_bytes(data)
        objects = open_objects(f"file://{folder}/objects")
        try:
            restore(database, objects, path, NOW)
        except DatabaseError:
            found = [one for one in Path(folder).rglob("*") if one.is_file()]
            assert found == [path]
            with database.engine.connect() as connection:
                for table in Base.metadata.sorted_tables:
                    assert not connection.scalar(select(func.count()).select_from(table))
            return False
        assert {one.relative_to(folder).parts[0] for one in Path(folder).rglob("*")} == {
            "all.tar",
            "objects",
        }
        with database.engine.begin() as connection:
            for table in reversed(Base.metadata.sorted_tables):
                connection.execute(delete(table))
        return True


_VALUES = st.one_of(
    st.none(),
    st.integers(),
    st.sampled_from([2**70, 1e308, float("nan")]),
    st.text(max_size=6),
    st.lists(st.integers(), max_size=2),
    st.builds(
        lambda kind, inner: {kind: inner},
        st.sampled_from(["time", "bytes", "json", "x"]),
        st.one_of(
            st.text(max_size=6), st.integers(), st.sampled_from(["0001-01-01T00:00:00+23:59"])
        ),
    ),
)


@FEWER
@given(
    table=st.sampled_from(["person", "model", "audit_event", "nothing", "alembic_version", "../x"]),
    name=st.sampled_from([*_PERSON, "consent_purposes", "consent_until", "nothing"]),
    value=_VALUES,
)
def test_rows_with_anything_in_a_column(database: Database, table: str, name: str, value: object):
    row = json.dumps(_PERSON | {name: value}).encode() + b"\n"
    _restored(database, _archive({f"rows/{table}.jsonl": row}))


@FEW
@given(
    line=st.one_of(
        st.binary(max_size=30),
        st.sampled_from([b"[" * 100_000, b"3", b"[]"]),
        st.dictionaries(st.text(max_size=3), _VALUES).map(lambda row: json.dumps(row).encode()),
    )
)
def test_lines_that_are_no_rows(line: bytes):
    with suppress(BrokenArchive):
        assert isinstance(decode_row(line), dict)


@FEWER
@given(
    name=st.sampled_from(
        ["revision", "made_at", "forget_by", "rows", "hashes", "objects", "bytes", "lost", "x"]
    ),
    value=_VALUES,
)
def test_manifests_with_anything_in_a_field(database: Database, name: str, value: object):
    _restored(database, _archive({}, **{name: value}))


@pytest.mark.parametrize("owner", ["..", "../..", "a/b", "", "/etc", "a\nb", "ä"])
def test_objects_of_no_owner_are_refused(database: Database, owner: str):
    data = b"bytes"
    name = f"objects/{owner}/{hashlib.sha256(data).hexdigest()}"
    assert not _restored(database, _archive({name: data}))


def test_a_whole_archive_is_taken(database: Database):
    data, row = b"bytes", json.dumps(_PERSON).encode()
    name = f"objects/{'a' * 32}/{hashlib.sha256(data).hexdigest()}"
    assert _restored(database, _archive({"rows/person.jsonl": row, name: data}))


@FEWER
@given(
    at=st.integers(0, 1 << 20), value=st.integers(0, 255), cut=st.none() | st.integers(0, 1 << 14)
)
def test_archives_that_were_changed(database: Database, at: int, value: int, cut: int | None):
    data = bytearray(_archive({"rows/person.jsonl": json.dumps(_PERSON).encode()}))
    data[at % len(data)] = value
    _restored(database, bytes(data[:cut]))


@pytest.mark.parametrize(
    "kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE, tarfile.FIFOTYPE]
)
def test_an_archive_holds_files_alone(database: Database, kind: bytes):
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as made:
        entry = tarfile.TarInfo("rows/person.jsonl")
        entry.type, entry.linkname = kind, "/etc/passwd"
        made.addfile(entry)
    assert not _restored(database, file.getvalue())


def test_a_sparse_entry_of_any_length_is_refused_at_once(database: Database):
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w", format=tarfile.PAX_FORMAT) as made:
        entry = tarfile.TarInfo("rows/person.jsonl")
        size = str(1 << 50)
        entry.pax_headers = {
            "GNU.sparse.major": "0",
            "GNU.sparse.minor": "1",
            "GNU.sparse.name": entry.name,
            "GNU.sparse.size": size,
            "GNU.sparse.map": f"{size},0",
        }
        made.addfile(entry)
    assert not _restored(database, file.getvalue())


@FEW
@given(
    at=st.integers(0, 1 << 20), value=st.integers(0, 255), cut=st.none() | st.integers(0, 1 << 18)
)
def test_encrypted_files_that_were_changed(at: int, value: int, cut: int | None):
    file = io.BytesIO()
    plain = bytes(range(256)) * 600
    with EncryptingWriter(file, SECRET) as writer:
        writer.write(plain)
    whole = file.getvalue()
    data = bytearray(whole)
    data[at % len(data)] = value
    damaged = bytes(data[:cut])
    try:
        read = DecryptingReader(io.BytesIO(damaged), SECRET, "all.tar").read()
    except (SceneError, BrokenArchive):
        assert damaged != whole
        return
    # never anything but what was written
    assert (read, damaged) == (plain, whole)
