"""Looks at strangers' files from requests: few at once, and the others wait without a thread.

Each look is a process that may take gigabytes and a minute (services.uploads.apart). Without a
bound a few hostile files would fill the memory, and the threads that everybody's requests need.
Whoever sends many files holds up nobody who sends one: a turn goes to who has the fewest under way,
and of those by turns.
"""

from __future__ import annotations

from asyncio import Event
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import ParamSpec, TypeVar

from anyio import CapacityLimiter, to_thread

from services.errors import Unavailable

AT_ONCE, MOST_WAITING, MOST_OF_ONE_WAITING = 2, 20, 8
_RETRY_S = 10
_Given = ParamSpec("_Given")
_Found = TypeVar("_Found")


class Turns:
    """Of one gateway; every method runs on its event loop."""

    def __init__(self) -> None:
        self._limiter = CapacityLimiter(AT_ONCE)
        self._held: Counter[str] = Counter()
        """How many turns each caller has now."""
        self._queues: dict[str, deque[Event]] = {}
        """Who waits, by caller."""
        self._given, self._last = count(1), dict[str, int]()
        """Number of the newest turn of each caller who has one or waits."""

    @property
    def waiting(self) -> int:
        """How many look later."""
        return sum(map(len, self._queues.values()))

    async def run(
        self,
        caller: str,
        look: Callable[_Given, _Found],
        *args: _Given.args,
        **named: _Given.kwargs,
    ) -> _Found:
        """What `look` returns, on a thread, once it is the turn of `caller`.

        Raises Unavailable where too many wait already, of everybody's or of the caller's.
        """
        await self._turn(caller)
        try:
            return await to_thread.run_sync(partial(look, *args, **named), limiter=self._limiter)
        finally:
            self._give_back(caller)

    async def _turn(self, caller: str) -> None:
        if self._held.total() < AT_ONCE:  # then nobody waits
            self._give(caller)
            return
        self._require_room(caller)
        turn = Event()
        self._queues.setdefault(caller, deque()).append(turn)
        try:
            await turn.wait()
        except BaseException:  # the request is gone
            if turn.is_set():
                self._give_back(caller)
            else:
                self._leave(caller, turn)
            raise

    def _require_room(self, caller: str) -> None:
        own = len(self._queues.get(caller, ()))
        if self.waiting < MOST_WAITING and own < MOST_OF_ONE_WAITING:
            return
        raise Unavailable(
            f"at most {MOST_WAITING} files may wait to be looked at, and {MOST_OF_ONE_WAITING} of "
            f"one account; got one more; send it again, or its last piece, in {_RETRY_S} s",
            _RETRY_S,
        )

    def _give(self, caller: str) -> None:
        self._held[caller] += 1
        self._last[caller] = next(self._given)

    def _give_back(self, caller: str) -> None:
        self._held -= Counter((caller,))
        if self._queues:
            following = min(self._queues, key=self._precedence)
            turn = self._queues[following][0]
            self._leave(following, turn)
            self._give(following)
            turn.set()
        self._forget(caller)

    def _precedence(self, caller: str) -> tuple[int, int]:
        return self._held[caller], self._last.get(caller, 0)

    def _leave(self, caller: str, turn: Event) -> None:
        self._queues[caller].remove(turn)
        if not self._queues[caller]:
            del self._queues[caller]
        self._forget(caller)

    def _forget(self, caller: str) -> None:
        if caller not in self._held and caller not in self._queues:
            self._last.pop(caller, None)
