"""Lines between programs of this machine that are spoilt on purpose."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

_MOST_BYTES = 16_384


class Line(Protocol):
    """Carries until it is ended."""

    def run(self) -> None:
        """Carry until `end`."""
        ...

    def end(self) -> None:
        """Carry no more."""
        ...


Kind = TypeVar("Kind", bound=Line)


@contextmanager
def running(line: Kind) -> Iterator[Kind]:
    """`line`, on a thread of its own."""
    thread = threading.Thread(target=line.run, daemon=True)
    thread.start()
    try:
        yield line
    finally:
        line.end()
        thread.join(10.0)


async def pour(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Carry one way until either end of a connection is gone; closes `writer`."""
    try:
        while data := await reader.read(_MOST_BYTES):
            writer.write(data)
            await writer.drain()
    except ConnectionError:
        pass
    writer.close()
