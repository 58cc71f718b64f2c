"""Receives a request's body to a file on disk, never whole in memory, never beyond its limit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from python_multipart import MultipartParser
from python_multipart.exceptions import MultipartParseError
from python_multipart.multipart import parse_options_header
from starlette.requests import ClientDisconnect

from services.api.body_limit import lift_body_limit
from services.errors import InvalidForm
from services.uploads.spool import Spool, too_large

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

_FIELD = b"file"
_WRITE_BYTES = 1 << 20
_OVERHEAD_BYTES = 64 << 10
"""Boundaries and headers of a multipart body, beside the file."""


async def receive_file(request: Request, into: Spool) -> None:
    """Receive the field `file` of a multipart form (RFC 7578).

    Raises TooLarge as soon as the limit is passed, InvalidForm for another body.
    """
    lift_body_limit(request)
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
            if into.buffered_bytes >= _WRITE_BYTES:
                await run_in_threadpool(into.flush)
        parser.finalize()
    except MultipartParseError as error:
        raise _bad_form(f"a body that is none ({error})") from error
    if not form.complete:
        raise _bad_form("none")
    await run_in_threadpool(into.flush)
    into.close()


async def receive_raw(request: Request, into: Spool) -> bool:
    """Receive the body itself. False where the sender went away half-way: `into` has what came."""
    lift_body_limit(request)
    whole = True
    try:
        async for data in request.stream():
            into.add(data)
            if into.buffered_bytes >= _WRITE_BYTES:
                await run_in_threadpool(into.flush)
    except ClientDisconnect:
        whole = False
    await run_in_threadpool(into.flush)
    into.close()
    return whole


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
