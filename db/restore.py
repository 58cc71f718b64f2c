"""Puts an archive of `db.backup` into an empty installation, once all of it has been checked."""

from __future__ import annotations

import hashlib
import tarfile
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import IO

from sqlalchemy import Engine, MetaData, func, insert, inspect, select

from db.archive import LEASES, MANIFEST, OBJECTS, ROWS, Manifest, decode_row
from db.errors import ArchiveExpired, BrokenArchive, Conflict
from db.objects import CHUNK_BYTES, Objects
from db.unit_of_work import Database

_AGAIN = "make another, or take an older one"
_VERSION_TABLE = "alembic_version"


def restore(
    database: Database,
    objects: Objects,
    path: Path,
    now: datetime,
    on_progress: Callable[[float, str], None] = lambda _share, _what: None,
) -> Manifest:
    """Put everything in `path` into an empty database and store, on whatever engines they are.

    Raises BrokenArchive for half an archive or a damaged one, ArchiveExpired, Conflict where
    something is there already, MigrationFailed for a newer version's. Then nothing has changed.
    """
    database.ping()
    manifest = examine(path, now, on_progress)
    _require_empty(database.engine, objects)
    database.migrate(manifest.revision)
    put: set[str] = set()
    try:
        _put_objects(objects, path, manifest, put, on_progress)
        _insert_rows(database.engine, path)
    except BaseException:
        for owner in put:
            objects.delete_all(owner)
        raise
    database.migrate()
    return manifest


def examine(
    path: Path,
    now: datetime,
    on_progress: Callable[[float, str], None] = lambda _share, _what: None,
) -> Manifest:
    """What an archive holds, every byte of it checked. Raises BrokenArchive, ArchiveExpired."""
    try:
        manifest = _checked(path, on_progress)
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


def _checked(path: Path, on_progress: Callable[[float, str], None]) -> Manifest:
    manifest: Manifest | None = None
    hashes: dict[str, str] = {}
    objects = size = 0
    for name, file, at in _entries(path):
        on_progress(at, "checking")
        if manifest is not None:
            raise BrokenArchive(f"{MANIFEST} must be an archive's last entry; got {name} after it")
        if name == MANIFEST:
            manifest = Manifest.from_json(file.read())
            continue
        digest, length = _digest(file)
        if name.startswith(ROWS):
            hashes[name.removeprefix(ROWS).removesuffix(".jsonl")] = digest
        elif name.startswith(OBJECTS) and name.rsplit("/", 1)[-1] == digest:
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
    path: Path,
    manifest: Manifest,
    put: set[str],
    on_progress: Callable[[float, str], None],
) -> None:
    for name, file, at in _entries(path):
        if not name.startswith(OBJECTS):
            continue
        on_progress(at, "objects")
        owner, sha256 = name.removeprefix(OBJECTS).split("/")
        put.add(owner)
        if objects.put(owner, _pieces(file)).sha256 != sha256:
            raise BrokenArchive(f"{name} must be as it was put; got other bytes; {_AGAIN}")


def _insert_rows(engine: Engine, path: Path) -> None:
    """In one transaction, parents before children."""
    stored = MetaData()
    stored.reflect(engine)
    lines = {
        name.removeprefix(ROWS).removesuffix(".jsonl"): file.read().splitlines()
        for name, file, _ in _entries(path)
        if name.startswith(ROWS)
    }
    with engine.begin() as connection:
        for table in stored.sorted_tables:
            for line in lines.get(table.name, ()):
                connection.execute(insert(table).values(**decode_row(line)))


def _entries(path: Path) -> Iterator[tuple[str, IO[bytes], float]]:
    """Name, content and the share of the archive that is behind each entry's beginning.

    Raises tarfile.TarError, also where the content is read.
    """
    whole = path.stat().st_size
    with tarfile.open(path, "r:") as archive:
        for entry in archive:
            file = archive.extractfile(entry)
            if file is None:
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
