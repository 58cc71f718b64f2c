"""Looks at strangers' files from requests: few at once, and the others wait without a thread.

Each look is a process that may take gigabytes and a minute (services.uploads.apart). Without a
bound a few hostile files would fill the memory, and the threads that everybody's requests need.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import ParamSpec, TypeVar

from anyio import CapacityLimiter, to_thread

from services.errors import Unavailable

AT_ONCE, MOST_WAITING = 2, 20
_RETRY_S = 10
_Given = ParamSpec("_Given")
_Found = TypeVar("_Found")


class Turns:
    """Of one gateway; every method runs on its event loop."""

    def __init__(self) -> None:
        self._limiter = CapacityLimiter(AT_ONCE)

    @property
    def waiting(self) -> int:
        """How many look later."""
        return self._limiter.statistics().tasks_waiting

    async def run(
        self, look: Callable[_Given, _Found], *args: _Given.args, **named: _Given.kwargs
    ) -> _Found:
        """What `look` returns, on a thread, once it is its turn.

        Raises Unavailable where too many wait already.
        """
        if self.waiting >= MOST_WAITING:
            raise Unavailable(
                f"at most {MOST_WAITING} files may wait to be looked at; got one more; send it "
                f"again, or its last piece, in {_RETRY_S} s",
                _RETRY_S,
            )
        return await to_thread.run_sync(partial(look, *args, **named), limiter=self._limiter)
