"""Puts an archive of `db.backup` into an empty installation, once all of it has been checked."""

from __future__ import annotations

import hashlib
import re
import tarfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any, cast

from sqlalchemy import Connection, Engine, MetaData, Table, func, insert, inspect, select
from sqlalchemy.exc import OperationalError, SQLAlchemyError

from db.archive import LEASES, MANIFEST, OBJECTS, ROWS, Manifest, decode_row
from db.encrypted_file import DecryptingReader, is_encrypted
from db.errors import ArchiveExpired, BrokenArchive, Conflict
from db.objects import CHUNK_BYTES, Objects
from db.unit_of_work import Database
from scene.errors import InvalidInput

_AGAIN = "make another, or take an older one"
_VERSION_TABLE = "alembic_version"
_OBJECT = re.compile(OBJECTS + r"(?P<owner>[\w-]+)/(?P<sha256>[0-9a-f]{64})", re.ASCII)
_DOES_NOT_FIT = (SQLAlchemyError, ValueError, TypeError, AttributeError, OverflowError)
"""What a row of other columns, or with values of other kinds, leads to."""


def restore(
    database: Database,
    objects: Objects,
    path: Path,
    now: datetime,
    on_progress: Callable[[float, str], None] = lambda _share, _what: None,
    secret: bytes | None = None,
) -> Manifest:
    """Put everything in `path` into an empty database and store, on whatever engines they are.

    `secret` is that of an encrypted archive, and None of one that is not.

    Raises BrokenArchive for half an archive or a damaged one, ArchiveExpired, Conflict where
    something is there already, MigrationFailed for a newer version's, InvalidInput for another
    secret. Then nothing has changed.
    """
    database.ping()
    archive = _Archive(path, secret)
    manifest = _examined(archive, now, on_progress)
    _require_empty(database.engine, objects)
    database.migrate(manifest.revision)
    put: set[str] = set()
    try:
        _put_objects(objects, archive, put, on_progress)
        _insert_rows(database.engine, archive)
    except BaseException:
        for owner in put:
            objects.delete_all(owner)
        raise
    database.migrate()
    return manifest


@dataclass(frozen=True)
class _Archive:
    """A file, and what it was encrypted with."""

    path: Path
    secret: bytes | None

    @contextmanager
    def content(self) -> Iterator[IO[bytes]]:
        """The tar. Raises InvalidInput, BrokenArchive."""
        name, encrypted = self.path.name, is_encrypted(self.path)
        if encrypted and self.secret is None:
            raise InvalidInput(
                f"{name} is encrypted: its key must be named; got none; add --key-file"
            )
        if not encrypted and self.secret is not None:
            raise InvalidInput(
                f"{name} must be encrypted where a key is named; got one that is not, or whose "
                "beginning is damaged; leave out --key-file if you know where it comes from"
            )
        with self.path.open("rb") as file:
            if self.secret is None:
                yield file
            else:
                yield cast("IO[bytes]", DecryptingReader(file, self.secret, name))


def _examined(
    archive: _Archive, now: datetime, on_progress: Callable[[float, str], None]
) -> Manifest:
    """What an archive holds, every byte of it checked. Raises BrokenArchive, ArchiveExpired."""
    path = archive.path
    try:
        manifest = _checked(archive, on_progress)
    except tarfile.TarError as error:
        raise BrokenArchive(
            f"{path.name} must be a whole archive; got one that breaks off or is none ({error}); "
            f"{_AGAIN}"
        ) from error
    if datetime.fromisoformat(manifest.forget_by) < now:
        raise ArchiveExpired(
            f"an archive must be restored by the day it is to be forgotten; got one of "
            f"{manifest.made_at}, which was to be by {manifest.forget_by}: it may hold people who "
            "were erased since; take a younger one"
        )
    return manifest


def _checked(archive: _Archive, on_progress: Callable[[float, str], None]) -> Manifest:
    path = archive.path
    manifest: Manifest | None = None
    hashes: dict[str, str] = {}
    objects = size = 0
    for name, file, at in _entries(archive):
        on_progress(at, "checking")
        if manifest is not None:
            raise BrokenArchive(f"{MANIFEST} must be an archive's last entry; got {name} after it")
        if name == MANIFEST:
            manifest = Manifest.from_json(file.read())
            continue
        digest, length = _digest(file)
        if name.startswith(ROWS):
            hashes[name.removeprefix(ROWS).removesuffix(".jsonl")] = digest
        elif (found := _OBJECT.fullmatch(name)) and found["sha256"] == digest:
            objects, size = objects + 1, size + length
        else:
            raise BrokenArchive(f"{name} must be as it was put; got other bytes; {_AGAIN}")
    if manifest is None:
        raise BrokenArchive(
            f"{path.name} must be a whole archive; got one without its end, as where copying was "
            f"cut off; {_AGAIN}"
        )
    if (hashes, objects, size) != (manifest.hashes, manifest.objects, manifest.bytes):
        raise BrokenArchive(
            f"{path.name} must hold all that its manifest names; got {objects} of "
            f"{manifest.objects} objects, or tables that differ; {_AGAIN}"
        )
    return manifest


def _require_empty(engine: Engine, objects: Objects) -> None:
    if owners := objects.owners():
        raise Conflict(
            f"the object store must be empty to restore into; got objects of {len(owners)} owners; "
            "name an empty one (METANERF_OBJECT_STORE_URL)"
        )
    aside = (_VERSION_TABLE, LEASES)
    known = [name for name in inspect(engine).get_table_names() if name not in aside]
    stored = MetaData()
    stored.reflect(engine, only=known)
    with engine.connect() as connection:
        for table in stored.sorted_tables:
            if count := connection.scalar(select(func.count()).select_from(table)):
                raise Conflict(
                    f"the database must be empty to restore into; got {count} rows of "
                    f"{table.name}; name an empty one (METANERF_DATABASE_URL)"
                )


def _put_objects(
    objects: Objects,
    archive: _Archive,
    put: set[str],
    on_progress: Callable[[float, str], None],
) -> None:
    for name, file, at in _entries(archive):
        if not (found := _OBJECT.fullmatch(name)):
            continue
        on_progress(at, "objects")
        put.add(found["owner"])
        if objects.put(found["owner"], _pieces(file)).sha256 != found["sha256"]:
            raise BrokenArchive(f"{name} must be as it was put; got other bytes; {_AGAIN}")


def _insert_rows(engine: Engine, archive: _Archive) -> None:
    """In one transaction, parents before children."""
    stored = MetaData()
    stored.reflect(engine)
    lines = {
        name.removeprefix(ROWS).removesuffix(".jsonl"): file.read().splitlines()
        for name, file, _ in _entries(archive)
        if name.startswith(ROWS)
    }
    known = stored.tables.keys() - {_VERSION_TABLE, LEASES}
    if unknown := lines.keys() - known:
        raise BrokenArchive(
            f"rows must be of tables that a backup holds; got some of {', '.join(sorted(unknown))}"
        )
    with engine.begin() as connection:
        for table in stored.sorted_tables:
            for line in lines.get(table.name, ()):
                _insert_row(connection, table, decode_row(line))


def _insert_row(connection: Connection, table: Table, values: dict[str, Any]) -> None:
    try:
        connection.execute(insert(table).values(**values))
    except OperationalError:  # the database is away
        raise
    except _DOES_NOT_FIT as error:
        # without its values, which SQLAlchemy's own words have
        why = getattr(error, "orig", None) or type(error).__name__
        raise BrokenArchive(
            f"a row of {table.name} must fit its table; got one that does not ({why}); {_AGAIN}"
        ) from error


def _entries(archive: _Archive) -> Iterator[tuple[str, IO[bytes], float]]:
    """Name, content and the share of the archive that is behind each entry's beginning.

    Raises tarfile.TarError, also where the content is read.
    """
    whole = archive.path.stat().st_size
    with archive.content() as content, tarfile.open(fileobj=content, mode="r:") as tar:
        for entry in tar:
            file = tar.extractfile(entry) if entry.isreg() else None
            # a sparse one may say that it is of any length
            if file is None or entry.issparse():
                raise BrokenArchive(f"an archive must hold files alone; got {entry.name}")
            yield entry.name, file, entry.offset / max(whole, 1)


def _pieces(file: IO[bytes]) -> Iterator[bytes]:
    while piece := file.read(CHUNK_BYTES):
        yield piece


def _digest(file: IO[bytes]) -> tuple[str, int]:
    digest, length = hashlib.sha256(), 0
    for piece in _pieces(file):
        digest.update(piece)
        length += len(piece)
    return digest.hexdigest(), length
