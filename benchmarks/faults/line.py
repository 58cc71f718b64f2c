"""Lines between programs of this machine that are spoilt on purpose."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar


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
