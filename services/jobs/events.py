"""Wake-ups: something about a topic has changed, look at the database again.

An event carries nothing and may be lost, so whoever waits also looks from time to time. Without
Redis that is all there is between processes; with it, a look follows a change at once. Redis may go
away and come back: waits become looks meanwhile, and events travel again as soon as it answers.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Protocol

import redis
import redis.asyncio
from redis.asyncio.client import PubSub
from redis.client import PubSub as SyncPubSub

log = logging.getLogger(__name__)

QUEUE = "queue"
"""Topic: a job was queued or cancelled."""
_POLL_S = 0.25
"""How often to look where no event comes from other processes."""
_ANSWER_S = 1.0
"""Redis answers in milliseconds or is away: who publishes holds up a control channel meanwhile."""
_PAUSE_S = 2.0
"""Between two attempts to publish while Redis is away, so that one that hangs costs little."""
_HEALTH_CHECK_S = 10
_PREFIX = "metanerf:"


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
        """Raise redis.RedisError unless events travel."""
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
        await asyncio.sleep(min(timeout_s, _POLL_S))


class RedisEvents:
    """Events between processes. While Redis is away, everybody just looks often."""

    def __init__(self, url: str) -> None:
        self._options = {
            "url": url,
            "socket_connect_timeout": _ANSWER_S,
            "socket_timeout": _ANSWER_S,
            "health_check_interval": _HEALTH_CHECK_S,
        }
        self._client = redis.Redis.from_url(**self._options)
        self._local = threading.local()
        self._outage = _Outage()

    def publish(self, topic: str) -> None:
        if self._outage.pauses():
            return
        try:
            self._client.publish(_PREFIX + topic, b"1")
            self._outage.end()
        except redis.RedisError as error:
            self._outage.begin(error)

    def wait(self, topic: str, timeout_s: float) -> None:
        started = time.monotonic()
        try:
            channel = self._subscribed(topic)
            while (left := timeout_s - (time.monotonic() - started)) > 0:
                message = channel.get_message(ignore_subscribe_messages=False, timeout=left)
                if message is not None and message["type"] == "message":
                    return
        except redis.RedisError as error:
            self._outage.begin(error)
            self._local.__dict__.clear()
            time.sleep(min(timeout_s, _POLL_S))

    def _subscribed(self, topic: str):
        """This thread's subscription, kept so that no event between two waits is missed."""
        channels: dict[str, SyncPubSub] = self._local.__dict__.setdefault("channels", {})
        if topic not in channels:
            channel = self._client.pubsub()
            channel.subscribe(_PREFIX + topic)
            channels[topic] = channel
            self._outage.end()
        return channels[topic]

    @asynccontextmanager
    async def listen(self, topic: str) -> AsyncIterator[Listener]:
        client = redis.asyncio.Redis.from_url(**self._options)
        channel = client.pubsub()
        listener = _RedisListener(channel, _PREFIX + topic, self._outage)
        try:
            await listener.subscribe()
            yield listener
        finally:
            await channel.aclose()
            await client.aclose()

    def ping(self) -> None:
        self._client.ping()

    def close(self) -> None:
        self._client.close()


class _RedisListener:
    """One subscription, made again once Redis is back."""

    def __init__(self, channel: PubSub, name: str, outage: _Outage) -> None:
        self._channel, self._name, self._outage = channel, name, outage

    async def subscribe(self) -> bool:
        """Whether events come from now on."""
        try:
            await self._channel.subscribe(self._name)
            # its confirmation: what is published from here on comes
            if await self._channel.get_message(timeout=_ANSWER_S) is not None:
                self._outage.end()
            return True
        except redis.RedisError as error:
            self._outage.begin(error)
            return False

    async def wait(self, timeout_s: float) -> None:
        if not self._channel.subscribed:
            # once it succeeds, that counts as an event too: some may have been missed
            if not await self.subscribe():
                await asyncio.sleep(min(timeout_s, _POLL_S))
            return
        try:
            # a lost connection is made and subscribed again here, and its confirmation is an event
            if await self._channel.get_message(timeout=timeout_s) is not None:
                self._outage.end()
        except redis.RedisError as error:
            self._outage.begin(error)
            await asyncio.sleep(min(timeout_s, _POLL_S))


class _Outage:
    """Whether Redis is away: told once when it goes and once when it is back."""

    def __init__(self) -> None:
        self._failed_s: float | None = None

    def pauses(self) -> bool:
        """Whether the last failure is so recent that another attempt would fail as well."""
        failed_s = self._failed_s
        return failed_s is not None and time.monotonic() - failed_s < _PAUSE_S

    def begin(self, error: redis.RedisError) -> None:
        if self._failed_s is None:
            log.warning("Redis is away, polling: %s", error)
        self._failed_s = time.monotonic()

    def end(self) -> None:
        if self._failed_s is not None:
            log.warning("Redis is back")
        self._failed_s = None


def open_events(redis_url: str | None) -> Events:
    """Events by Redis where there is one, else within this process."""
    return RedisEvents(redis_url) if redis_url else LocalEvents()
