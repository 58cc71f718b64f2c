"""Wake-ups between processes, by Redis; see `services.jobs.events`."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import redis
import redis.asyncio
from redis.asyncio.client import PubSub
from redis.client import PubSub as SyncPubSub

from services.jobs.events import POLL_S, Listener
from services.redis_outage import Outage

_ANSWER_S = 1.0
"""Redis answers in milliseconds or is away: who publishes holds up a control channel meanwhile."""
_HEALTH_CHECK_S = 10
_PREFIX = "metanerf:"


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
        self._outage = Outage("polling")

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
            time.sleep(min(timeout_s, POLL_S))

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
        try:
            self._client.ping()
        except redis.RedisError as error:
            raise ConnectionError(str(error)) from error

    def close(self) -> None:
        self._client.close()


class _RedisListener:
    """One subscription, made again once Redis is back."""

    def __init__(self, channel: PubSub, name: str, outage: Outage) -> None:
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
                await asyncio.sleep(min(timeout_s, POLL_S))
            return
        try:
            # a lost connection is made and subscribed again here, and its confirmation is an event
            if await self._channel.get_message(timeout=timeout_s) is not None:
                self._outage.end()
        except redis.RedisError as error:
            self._outage.begin(error)
            await asyncio.sleep(min(timeout_s, POLL_S))
