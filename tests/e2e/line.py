"""Lines between a page and the service that tests spoil."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar


class Line(Protocol):
    """Carries until it is ended."""

    def run(self) -> None: ...

    def end(self) -> None: ...


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
