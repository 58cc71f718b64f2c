"""A file on disk that is received in pieces, never beyond its limit."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from db.objects import naming_errors
from services.errors import TooLarge
from services.jobs.scratch import scratch_folder


@dataclass(eq=False)
class Spool:
    """A file being received."""

    path: Path
    limit_bytes: int
    filename: str = ""
    size: int = 0
    _file: IO[bytes] | None = None
    buffered_bytes: int = 0
    """In memory, not yet on disk."""
    _buffer: list[bytes] = field(default_factory=list)
    _digest: hashlib._Hash = field(default_factory=hashlib.sha256)

    @property
    def sha256(self) -> str:
        """Of what has come so far."""
        return self._digest.hexdigest()

    def add(self, data: bytes) -> None:
        """Take bytes into memory. Raises TooLarge beyond the limit."""
        self.size += len(data)
        if self.size > self.limit_bytes:
            raise too_large(self.limit_bytes, f"more than {self.limit_bytes}")
        self._buffer.append(data)
        self.buffered_bytes += len(data)

    def flush(self) -> None:
        """Write the buffer to disk. Raises StoreFull."""
        pieces, self._buffer, self.buffered_bytes = self._buffer, [], 0
        with naming_errors():
            if self._file is None:
                self._file = self.path.open("wb", buffering=0)
            for piece in pieces:
                self._digest.update(piece)
                left = memoryview(piece)
                while left:  # unbuffered, so a nearly full disk may take a part
                    left = left[self._file.write(left) :]

    def close(self) -> None:
        """Finish the file."""
        file, self._file = self._file, None
        if file is not None:
            file.close()


@contextmanager
def spool(folder: Path, limit_bytes: int) -> Iterator[Spool]:
    """A file to receive into; gone afterwards, whatever happens."""
    with scratch_folder(folder) as own:
        made = Spool(own / "body", limit_bytes)
        try:
            yield made
        finally:
            made.close()


def join(pieces: Iterable[bytes], into: Spool) -> None:
    """Append pieces that were received before."""
    for piece in pieces:
        into.add(piece)
        into.flush()


def too_large(limit_bytes: int, got: str) -> TooLarge:
    """The error of a body over the limit."""
    return TooLarge(
        f"an upload must have at most {limit_bytes} bytes; got {got}; cut the clip or shrink it",
    )
