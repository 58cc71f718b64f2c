"""A sequence folder as one object: an uncompressed tar, streamed both ways.

Pictures are compressed already, so a second compression would only cost time.
"""

from __future__ import annotations

import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path

from db.objects import Objects, StoredObject, fetch, file_chunks
from scene.errors import InvalidInput


def pack(objects: Objects, owner: str, folder: Path) -> StoredObject:
    """Store `folder`. The same folder gives the same bytes, whoever packs it and when."""
    with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
        path = Path(scratch) / "sequence.tar"
        with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as archive:
            for file in sorted(_files(folder)):
                archive.add(file, file.relative_to(folder).as_posix(), filter=_anonymous)
        return objects.put(owner, file_chunks(path))


def unpack(objects: Objects, owner: str, sha256: str, folder: Path) -> None:
    """Bring a packed sequence back into the new folder `folder`.

    Raises InvalidInput for bytes that are no pack of ours.
    """
    folder.mkdir(parents=True)
    path = folder.with_name(f"{folder.name}.tar")
    try:
        fetch(objects, owner, sha256, path)
        with tarfile.open(path, "r:") as archive:
            archive.extractall(folder, filter="data")
    except tarfile.TarError as error:
        raise InvalidInput(f"a stored sequence must be a tar archive; got {error}") from error
    finally:
        path.unlink(missing_ok=True)


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in folder.rglob("*") if path.is_file())


def _anonymous(entry: tarfile.TarInfo) -> tarfile.TarInfo:
    entry.uid = entry.gid = entry.mtime = 0
    entry.uname = entry.gname = ""
    entry.mode = 0o644
    return entry
