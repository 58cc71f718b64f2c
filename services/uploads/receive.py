"""Receives a request's body to a file on disk, never whole in memory, never beyond its limit."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from python_multipart import MultipartParser
from python_multipart.exceptions import MultipartParseError
from python_multipart.multipart import parse_options_header
from starlette.requests import ClientDisconnect

from db.objects import naming_errors
from services.errors import InvalidForm, TooLarge
from services.jobs.scratch import scratch_folder
from services.limits import has_own_limit

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

_FIELD = b"file"
_WRITE_BYTES = 1 << 20
_OVERHEAD_BYTES = 64 << 10
"""Boundaries and headers of a multipart body, beside the file."""


@dataclass(eq=False)
class Spool:
    """A file being received."""

    path: Path
    limit_bytes: int
    filename: str = ""
    size: int = 0
    _file: IO[bytes] | None = None
    _waiting: list[bytes] = field(default_factory=list)
    _waiting_bytes: int = 0
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
        self._waiting.append(data)
        self._waiting_bytes += len(data)

    async def relieve(self, *, all_of_it: bool = False) -> None:
        """Write to disk what has gathered, off the event loop."""
        if all_of_it or self._waiting_bytes >= _WRITE_BYTES:
            await run_in_threadpool(self.flush)

    def flush(self) -> None:
        """Write to disk what has gathered. Raises StoreFull."""
        pieces, self._waiting, self._waiting_bytes = self._waiting, [], 0
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


async def receive_file(request: Request, into: Spool) -> None:
    """Receive the field `file` of a multipart form (RFC 7578).

    Raises TooLarge as soon as the limit is passed, InvalidForm for another body.
    """
    has_own_limit(request)
    boundary = _boundary(request)
    declared = request.headers.get("content-length", "")
    if declared.isdigit() and int(declared) > into.limit_bytes + _OVERHEAD_BYTES:
        raise too_large(into.limit_bytes, declared)
    form = _Form(into)
    parser = MultipartParser(boundary, form.callbacks())
    received = 0
    try:
        async for data in request.stream():
            received += len(data)
            if received > into.limit_bytes + _OVERHEAD_BYTES:
                raise too_large(into.limit_bytes, f"more than {into.limit_bytes}")
            parser.write(data)
            await into.relieve()
        parser.finalize()
    except MultipartParseError as error:
        raise _bad_form(f"a body that is none ({error})") from error
    if not form.complete:
        raise _bad_form("none")
    await into.relieve(all_of_it=True)
    into.close()


async def receive_raw(request: Request, into: Spool) -> bool:
    """Receive the body itself. False where the sender went away half-way: `into` has what came."""
    has_own_limit(request)
    whole = True
    try:
        async for data in request.stream():
            into.add(data)
            await into.relieve()
    except ClientDisconnect:
        whole = False
    await into.relieve(all_of_it=True)
    into.close()
    return whole


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


class _Form:
    """Listens to the parser; the file's bytes go to the spool, other fields are passed over."""

    def __init__(self, into: Spool) -> None:
        self.complete = False
        self._into = into
        self._header = b""
        self._value = b""
        self._wanted = False

    def callbacks(self) -> MultipartCallbacks:
        """By the parser's names."""
        return {
            "on_part_begin": self._begin,
            "on_header_field": self._on_field,
            "on_header_value": self._on_value,
            "on_header_end": self._on_header,
            "on_part_data": self._on_data,
            "on_part_end": self._end,
        }

    def _begin(self) -> None:
        self._wanted, self._header, self._value = False, b"", b""

    def _on_field(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def _on_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _on_header(self) -> None:
        if self._header.lower() == b"content-disposition" and not self.complete:
            _, options = parse_options_header(self._value)
            if options.get(b"name") == _FIELD:
                self._wanted = True
                self._into.filename = options.get(b"filename", b"").decode("utf-8", "replace")
        self._header, self._value = b"", b""

    def _on_data(self, data: bytes, start: int, end: int) -> None:
        if self._wanted:
            self._into.add(data[start:end])

    def _end(self) -> None:
        self.complete = self.complete or self._wanted


def _boundary(request: Request) -> bytes:
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    boundary = options.get(b"boundary")
    if kind != b"multipart/form-data" or not boundary:
        raise _bad_form(repr(request.headers.get("content-type", "no content-type")))
    return boundary


def _bad_form(got: str) -> InvalidForm:
    return InvalidForm(
        f"the body must be multipart/form-data with a field `file`; got {got}; send it as "
        "`curl -F file=@clip.mp4` does",
    )
