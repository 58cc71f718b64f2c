"""Object storage: bytes named by their own sha256, in a folder or in S3.

Key: `{owner}/{first two digits}/{sha256}`; the owner is a person's id, so that all of theirs lies
under one prefix. Bytes arrive under `incoming/` and are renamed when complete, so that nothing
half-written ever has a name; the row that points at them is written after. Putting the same bytes
twice is free of harm: the name is the same.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

import obstore
from obstore.exceptions import BaseError
from obstore.store import LocalStore, S3Store
from obstore.store import ObjectStore as Store

from db.errors import NotFound, StoreAway, StoreFull

INCOMING = "incoming"
"""Prefix of objects under way; never a person's id."""
CHUNK_BYTES = 1 << 20
SIGNED_S = 60
"""How long a signed address is good."""
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""The disk is full, or what this user or file may have of it."""
_PART_BYTES = 5 << 20
"""The smallest part that S3 takes but for the last."""


@dataclass(frozen=True)
class StoredObject:
    """What was put."""

    sha256: str
    bytes: int


@dataclass(frozen=True)
class ObjectInfo:
    """What lies in the store."""

    owner: str
    sha256: str
    bytes: int
    modified_at: datetime


class Objects(Protocol):
    """Where bytes are kept."""

    def put(self, owner: str, chunks: Iterable[bytes]) -> StoredObject:
        """Store a stream, whole or not at all; its name and size in bytes.

        Raises StoreFull, StoreAway; what the stream itself raises passes through.
        """
        ...

    def stream(self, owner: str, sha256: str) -> Iterator[bytes]:
        """The bytes, piece by piece. Raises NotFound before the first piece, or StoreAway."""
        ...

    def delete(self, owner: str, sha256: str) -> None:
        """Remove an object; one that is gone already is no error. Raises StoreAway."""
        ...

    def delete_all(self, owner: str) -> int:
        """Remove everything of `owner`; the number of objects. Raises StoreAway."""
        ...

    def list(self, owner: str) -> Iterator[ObjectInfo]:
        """What `owner` has, with sizes in bytes, in no particular order. Raises StoreAway."""
        ...

    def owners(self) -> list[str]:
        """Everybody who has objects, sorted. Raises StoreAway."""
        ...

    def incoming(self) -> Iterator[tuple[str, datetime]]:
        """Names and times of what is under way, or was when its writer died. Raises StoreAway."""
        ...

    def drop_incoming(self, name: str) -> None:
        """Remove what a dead writer left. Raises NotFound where `name` is of none, StoreAway."""
        ...

    def signed_address(self, owner: str, sha256: str) -> str | None:
        """An address at which whoever has it may read an object for `SIGNED_S`; None where the
        store has none that clients reach."""
        ...

    def ping(self) -> None:
        """Raise StoreAway unless the store answers."""
        ...


class ObstoreObjects:
    """Objects in whatever obstore speaks to; see `Objects`."""

    def __init__(self, store: Store, outside: S3Store | None = None) -> None:
        """Args: outside: the same store as clients reach it."""
        self._store, self._outside = store, outside

    def put(self, owner: str, chunks: Iterable[bytes]) -> StoredObject:
        """See `Objects.put`."""
        digest, size = hashlib.sha256(), 0

        def hashed() -> Iterator[bytes]:
            nonlocal size
            for chunk in chunks:
                digest.update(chunk)
                size += len(chunk)
                yield bytes(chunk)

        name = f"{INCOMING}/{uuid.uuid4().hex}"
        with naming_errors():
            obstore.put(self._store, name, hashed(), use_multipart=True, chunk_size=_PART_BYTES)
            obstore.rename(self._store, name, _key(owner, digest.hexdigest()), overwrite=True)
        return StoredObject(digest.hexdigest(), size)

    def stream(self, owner: str, sha256: str) -> Iterator[bytes]:
        """See `Objects.stream`."""
        with naming_errors():
            found = obstore.get(self._store, _key(owner, sha256))
        return self._pieces(iter(found.stream(min_chunk_size=CHUNK_BYTES)))

    def _pieces(self, pieces: Iterator[object]) -> Iterator[bytes]:
        while True:
            with naming_errors():
                piece = next(pieces, None)
            if piece is None:
                return
            yield bytes(piece)  # type: ignore[call-overload]

    def delete(self, owner: str, sha256: str) -> None:
        """See `Objects.delete`."""
        with naming_errors():
            self._delete([_key(owner, sha256)])

    def delete_all(self, owner: str) -> int:
        """See `Objects.delete_all`."""
        with naming_errors():
            keys = [meta["path"] for batch in self._batches(owner) for meta in batch]
            self._delete(keys)
        return len(keys)

    def list(self, owner: str) -> Iterator[ObjectInfo]:
        """See `Objects.list`."""
        with naming_errors():
            for batch in self._batches(owner):
                for meta in batch:
                    sha256 = meta["path"].rsplit("/", 1)[-1]
                    yield ObjectInfo(owner, sha256, meta["size"], meta["last_modified"])

    def owners(self) -> list[str]:
        """See `Objects.owners`."""
        with naming_errors():
            found = obstore.list_with_delimiter(self._store)["common_prefixes"]
        return sorted(str(prefix) for prefix in found if str(prefix) != INCOMING)

    def incoming(self) -> Iterator[tuple[str, datetime]]:
        """See `Objects.incoming`."""
        with naming_errors():
            for batch in self._batches(INCOMING):
                for meta in batch:
                    yield meta["path"], meta["last_modified"]

    def drop_incoming(self, name: str) -> None:
        """See `Objects.drop_incoming`."""
        if not name.startswith(f"{INCOMING}/"):
            raise NotFound(f"name must be of an object under way; got {name!r}")
        with naming_errors():
            self._delete([name])

    def signed_address(self, owner: str, sha256: str) -> str | None:
        """See `Objects.signed_address`."""
        if self._outside is None:
            return None
        # without asking the store
        return obstore.sign(self._outside, "GET", _key(owner, sha256), timedelta(seconds=SIGNED_S))

    def ping(self) -> None:
        """See `Objects.ping`."""
        with naming_errors():
            next(iter(obstore.list(self._store, f"{INCOMING}/", chunk_size=1)), None)

    def _batches(self, prefix: str):
        return obstore.list(self._store, f"{prefix}/")

    def _delete(self, keys: list[str]) -> None:
        for key in keys:
            try:
                obstore.delete(self._store, key)
            except FileNotFoundError:
                continue


def open_objects(
    url: str,
    *,
    endpoint: str | None = None,
    public_endpoint: str | None = None,
    region: str = "us-east-1",
    access_key_id: str | None = None,
    secret_access_key: str | None = None,
) -> ObstoreObjects:
    """The store at `url`: `file:///a/folder` (made where missing) or `s3://bucket/prefix`.

    `public_endpoint` is the S3 store's address as clients reach it; None: they do not. Raises
    StoreAway for an address of another kind, or a folder that can't be made.
    """
    parts = urlsplit(url)
    if parts.scheme == "file":
        with naming_errors():
            Path(parts.path).mkdir(parents=True, exist_ok=True)
            return ObstoreObjects(LocalStore(parts.path, automatic_cleanup=True))
    if parts.scheme == "s3":
        config = {
            "region": region,
            "access_key_id": access_key_id,
            "secret_access_key": secret_access_key,
        }

        def at(address: str | None) -> S3Store:
            given = {key: one for key, one in (config | {"endpoint": address}).items() if one}
            return S3Store(
                parts.netloc,
                prefix=parts.path.strip("/") or None,
                client_options={"allow_http": True, "connect_timeout": "3s", "timeout": "5m"},
                retry_config={"max_retries": 2},
                **given,  # type: ignore[arg-type]
            )

        return ObstoreObjects(at(endpoint), at(public_endpoint) if public_endpoint else None)
    raise StoreAway(f"object store must be file:///folder or s3://bucket/prefix; got {url!r}")


def file_chunks(path: Path) -> Iterator[bytes]:
    """The bytes of a file, piece by piece."""
    with path.open("rb") as file:
        while chunk := file.read(CHUNK_BYTES):
            yield chunk


def fetch(objects: Objects, owner: str, sha256: str, path: Path) -> None:
    """Copy an object to `path`, whole or not at all. Raises NotFound, StoreFull, StoreAway."""
    partial = path.with_name(f"{path.name}.{uuid.uuid4().hex}.part")
    try:
        with naming_errors(), partial.open("wb") as file:
            for chunk in objects.stream(owner, sha256):
                file.write(chunk)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def free_bytes(folder: Path) -> int:
    """Free space where `folder` lies."""
    return shutil.disk_usage(folder).free


def _key(owner: str, sha256: str) -> str:
    return f"{owner}/{sha256[:2]}/{sha256}"


@contextmanager
def naming_errors() -> Iterator[None]:
    """Turns what stores and disks throw into the errors of this package."""
    try:
        yield
    except FileNotFoundError as error:
        raise NotFound("an object must be stored to be read; got one that is not") from error
    except OSError as error:
        if full := no_space(error):
            raise StoreFull(full) from error
        raise
    except BaseError as error:
        if full := no_space(error):
            raise StoreFull(full) from error
        raise StoreAway(
            f"the object store must answer; got: {_first_line(error)}; retry in a moment"
        ) from error


def no_space(error: BaseException) -> str | None:
    """What to tell where `error`, or what led to it, is that a disk is full; else None.

    Libraries wrap what the system says, some in words of their own, so their text counts too.
    """
    cause: BaseException | None = error
    while cause is not None:
        number = cause.errno if isinstance(cause, OSError) else None
        told = [known for known in _NO_SPACE if f"os error {known})" in str(cause)]
        for found in (number, *told):
            if found in _NO_SPACE:
                return f"the disk needs free space; got: {os.strerror(found)}; free some and retry"
        cause = cause.__cause__ or cause.__context__
    return None


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
