"""Wake-ups: something about a topic has changed, look at the database again.

An event carries nothing and may be lost, so whoever waits also looks from time to time. Without
Redis that is all there is between processes; with it, a look follows a change at once. Redis may go
away and come back: waits become looks meanwhile, and events travel again as soon as it answers.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Protocol

QUEUE = "queue"
"""Topic: a job was queued or cancelled."""
POLL_S = 0.25
"""How often to look where no event comes from other processes."""


def job_topic(job_id: str) -> str:
    """Topic: something about this job."""
    return f"job:{job_id}"


def meeting_topic(meeting_id: str) -> str:
    """Topic: who is in this meeting, how they look, or what they said, has changed."""
    return f"meeting:{meeting_id}"


class Listener(Protocol):
    """Waits for events of one topic."""

    async def wait(self, timeout_s: float) -> None:
        """Return at the next event, or a while later; never longer than `timeout_s`."""
        ...


class Events(Protocol):
    """Publishes and awaits wake-ups."""

    def publish(self, topic: str) -> None:
        """Wake whoever waits for `topic`; never fails."""
        ...

    def wait(self, topic: str, timeout_s: float) -> None:
        """Block until the next event or for `timeout_s`."""
        ...

    def listen(self, topic: str) -> AbstractAsyncContextManager[Listener]:
        """The same for the event loop: no event after entering is missed."""
        ...

    def ping(self) -> None:
        """Raise ConnectionError unless events travel."""
        ...

    def close(self) -> None: ...


class LocalEvents:
    """Events of this process; other processes are noticed by looking often."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._counts: dict[str, int] = {}

    def publish(self, topic: str) -> None:
        with self._changed:
            self._counts[topic] = self._counts.get(topic, 0) + 1
            self._changed.notify_all()

    def wait(self, topic: str, timeout_s: float) -> None:
        with self._changed:
            before = self._counts.get(topic, 0)
            self._changed.wait_for(lambda: self._counts.get(topic, 0) != before, timeout_s)

    @asynccontextmanager
    async def listen(self, topic: str) -> AsyncIterator[Listener]:
        yield _Poll()

    def ping(self) -> None:
        return

    def close(self) -> None:
        return


class _Poll:
    async def wait(self, timeout_s: float) -> None:
        await asyncio.sleep(min(timeout_s, POLL_S))
