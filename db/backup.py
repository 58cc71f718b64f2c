"""Copies a running installation into one archive: rows of one moment, then the objects they name.

Objects never change, and each is checked against its name on its way. One that goes meanwhile, for
instance with a person who is erased, makes the rows old: they are read again.
"""

from __future__ import annotations

import hashlib
import io
import os
import tarfile
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from pathlib import Path
from typing import IO, Any, cast

from sqlalchemy import Connection, Engine, MetaData, select, text
from sqlalchemy.exc import DBAPIError

from db.archive import LEASES, MANIFEST, OBJECTS, ROWS, Manifest, encode_row
from db.encrypted_file import EncryptingWriter
from db.errors import MigrationFailed, NotFound, StoreAway
from db.models import Base, SequenceState
from db.objects import Objects, fetch
from db.unit_of_work import Database

_ATTEMPTS = 3
Named = set[tuple[str, str]]
"""Owner and sha256 of objects that rows name."""


def back_up(
    database: Database,
    objects: Objects,
    path: Path,
    now: datetime,
    keep_for: timedelta,
    on_progress: Callable[[float, str], None] = lambda _share, _what: None,
    secret: bytes | None = None,
) -> Manifest:
    """Write everything to `path`, whole or not at all; only this user may read it. With a
    `secret` it is encrypted (db.encrypted_file).

    Raises MigrationFailed for a schema of another version, DatabaseAway, StoreFull, StoreAway also
    where objects keep going meanwhile.
    """
    database.ping()
    part = path.with_name(f"{path.name}.part")
    try:
        for _ in range(_ATTEMPTS):
            with (
                _private(part) as file,
                _encrypted(file, secret) as content,
                tarfile.open(fileobj=content, mode="w") as archive,
            ):
                made = _written(database, objects, archive, now, keep_for, on_progress)
            if made is not None:
                part.replace(path)
                return made
    finally:
        part.unlink(missing_ok=True)
    raise StoreAway(
        f"objects must stay while they are copied; got some that went in each of {_ATTEMPTS} "
        "attempts; try again when less is erased"
    )


def _written(
    database: Database,
    objects: Objects,
    archive: tarfile.TarFile,
    now: datetime,
    keep_for: timedelta,
    on_progress: Callable[[float, str], None],
) -> Manifest | None:
    """None where an object went that rows named when they were read, and name no more."""
    on_progress(0.0, "rows")
    with _snapshot(database.engine) as connection:
        revision = _revision(connection)
        named, counts, hashes = _write_rows(connection, archive)
    lost: list[str] = []
    copied = size = 0
    for owner, sha256 in sorted(named):
        on_progress(copied / len(named), "objects")
        written = _write_object(archive, objects, owner, sha256)
        if written is None:
            if (owner, sha256) not in _still_named(database.engine):
                return None
            lost.append(f"{owner}/{sha256}")
            continue
        copied, size = copied + 1, size + written
    manifest = Manifest(
        revision=revision,
        made_at=now.isoformat(),
        forget_by=(now + keep_for).isoformat(),
        rows=counts,
        hashes=hashes,
        objects=copied,
        bytes=size,
        lost=tuple(lost),
    )
    _add(archive, MANIFEST, io.BytesIO(manifest.to_json()))
    return manifest


@contextmanager
def _private(path: Path) -> Iterator[io.BufferedWriter]:
    """A new file that only this user may read: it holds people."""
    path.unlink(missing_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        yield file


@contextmanager
def _encrypted(file: IO[bytes], secret: bytes | None) -> Iterator[IO[bytes]]:
    """What to write the content of `file` to."""
    if secret is None:
        yield file
        return
    with EncryptingWriter(file, secret) as writer:
        yield cast("IO[bytes]", writer)


@contextmanager
def _snapshot(engine: Engine) -> Iterator[Connection]:
    """A connection that sees the rows of one moment."""
    options: dict[str, Any] = {"reads_only": True}
    if engine.dialect.name == "postgresql":
        options = {"isolation_level": "REPEATABLE READ"}
    with engine.execution_options(**options).connect() as connection:
        if engine.dialect.name == "postgresql":  # the archive may be written slowly
            connection.execute(text("SET LOCAL idle_in_transaction_session_timeout = 0"))
        yield connection


def _revision(connection: Connection) -> str:
    from db.migrations import head

    try:
        found = connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
    except DBAPIError:
        found = None
    if found != head():
        raise MigrationFailed(
            f"the schema must be of version {head()} to be copied; got {found}; start this "
            "version's gateway once"
        )
    return str(found)


def _write_rows(
    connection: Connection, archive: tarfile.TarFile
) -> tuple[Named, dict[str, int], dict[str, str]]:
    """Every row; which objects they name, how many there are of each table, its entry's hash."""
    stored = MetaData()
    stored.reflect(connection, only=[name for name in Base.metadata.tables if name != LEASES])
    named: Named = set()
    counts: dict[str, int] = {}
    hashes: dict[str, str] = {}
    for table in stored.sorted_tables:
        counts[table.name], digest = 0, hashlib.sha256()
        with tempfile.TemporaryFile() as lines:
            for row in connection.execute(select(table)):
                line = encode_row(table, row)
                lines.write(line)
                digest.update(line)
                counts[table.name] += 1
                named |= _named_by(table.name, dict(row._mapping))
            _add(archive, f"{ROWS}{table.name}.jsonl", lines)
        hashes[table.name] = digest.hexdigest()
    return named, counts, hashes


def _still_named(engine: Engine) -> Named:
    with _snapshot(engine) as connection:
        return {
            one
            for table in Base.metadata.sorted_tables
            for row in connection.execute(select(table))
            for one in _named_by(table.name, dict(row._mapping))
        }


def _named_by(table: str, row: dict[str, Any]) -> Named:
    """The objects that a row names; see `db.models.OBJECT`."""
    if table == "recording_chunk":
        return {(row["owner"], row["sha256"])}
    columns = [c.name for c in Base.metadata.tables[table].c if c.info.get("object")]
    if table == "sequence" and row["state"] == SequenceState.FORGOTTEN:
        columns.remove("source_sha256")  # stands there for the sake of uniqueness alone
    return {(row["person_id"], row[name]) for name in columns if row[name] is not None}


def _write_object(
    archive: tarfile.TarFile, objects: Objects, owner: str, sha256: str
) -> int | None:
    """Its size in bytes; None where the store hasn't got it, or not as it was put."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / sha256
        try:
            fetch(objects, owner, sha256, copy)
        except NotFound:
            return None
        with copy.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != sha256:
                return None
            return _add(archive, f"{OBJECTS}{owner}/{sha256}", file)


def _add(archive: tarfile.TarFile, name: str, file: Any) -> int:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode = file.seek(0, io.SEEK_END), 0o600
    file.seek(0)
    archive.addfile(entry, file)
    return entry.size
