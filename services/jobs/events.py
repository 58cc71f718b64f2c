"""Wake-ups: something about a topic has changed, look at the database again.

An event carries nothing and may be lost, so whoever waits also looks from time to time. Without
Redis that is all there is between processes; with it, a look follows a change at once.
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
        self._url = url
        self._client = redis.Redis.from_url(
            url, socket_connect_timeout=2, socket_timeout=5, health_check_interval=10
        )
        self._local = threading.local()

    def publish(self, topic: str) -> None:
        try:
            self._client.publish(_PREFIX + topic, b"1")
        except redis.RedisError as error:
            log.warning("event %s was not published: %s", topic, error)

    def wait(self, topic: str, timeout_s: float) -> None:
        started = time.monotonic()
        try:
            channel = self._subscribed(topic)
            while (left := timeout_s - (time.monotonic() - started)) > 0:
                message = channel.get_message(ignore_subscribe_messages=False, timeout=left)
                if message is not None and message["type"] == "message":
                    return
        except redis.RedisError as error:
            log.warning("Redis is away, polling: %s", error)
            self._local.__dict__.clear()
            time.sleep(min(timeout_s, _POLL_S))

    def _subscribed(self, topic: str):
        """This thread's subscription, kept so that no event between two waits is missed."""
        channels: dict[str, SyncPubSub] = self._local.__dict__.setdefault("channels", {})
        if topic not in channels:
            channel = self._client.pubsub()
            channel.subscribe(_PREFIX + topic)
            channels[topic] = channel
        return channels[topic]

    @asynccontextmanager
    async def listen(self, topic: str) -> AsyncIterator[Listener]:
        client = redis.asyncio.Redis.from_url(self._url, socket_connect_timeout=2)
        channel = client.pubsub()
        try:
            try:
                await channel.subscribe(_PREFIX + topic)
                listener: Listener = _RedisListener(channel)
            except redis.RedisError as error:
                log.warning("Redis is away, polling: %s", error)
                listener = _Poll()
            yield listener
        finally:
            await channel.aclose()
            await client.aclose()

    def ping(self) -> None:
        self._client.ping()

    def close(self) -> None:
        self._client.close()


class _RedisListener:
    def __init__(self, channel: PubSub) -> None:
        self._channel = channel

    async def wait(self, timeout_s: float) -> None:
        try:
            await self._channel.get_message(ignore_subscribe_messages=True, timeout=timeout_s)
        except redis.RedisError as error:
            log.warning("Redis is away, polling: %s", error)
            await asyncio.sleep(_POLL_S)


def open_events(redis_url: str | None) -> Events:
    """Events by Redis where there is one, else within this process."""
    return RedisEvents(redis_url) if redis_url else LocalEvents()
