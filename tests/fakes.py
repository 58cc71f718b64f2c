"""Fakes at our own seams: a full disk, a store that is away, a clock."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path

from obstore.store import LocalStore

from db.errors import StoreAway, StoreFull
from db.objects import ObstoreObjects, StoredObject


class Clock:
    """A clock that stands still until it is told to go on."""

    def __init__(self, now: datetime = datetime(2026, 1, 1, tzinfo=UTC)) -> None:
        self.now = now

    def __call__(self) -> datetime:
        return self.now

    def advance(self, **span: float) -> None:
        self.now += timedelta(**span)


class SmallObjects(ObstoreObjects):
    """A store on a disk with room for `capacity` bytes."""

    def __init__(self, folder: Path, capacity: int) -> None:
        super().__init__(LocalStore(folder, automatic_cleanup=True, mkdir=True))
        self._left = capacity

    def put(self, owner: str, chunks: Iterable[bytes]) -> StoredObject:
        def counted() -> Iterable[bytes]:
            for chunk in chunks:
                self._left -= len(chunk)
                if self._left < 0:
                    raise StoreFull("the object store needs free space; got: none; free some")
                yield chunk

        return super().put(owner, counted())


class AwayObjects(ObstoreObjects):
    """A store that no longer answers."""

    def ping(self) -> None:
        raise StoreAway("the object store must answer; got: connection refused; retry in a moment")
