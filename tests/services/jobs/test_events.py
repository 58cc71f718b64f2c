"""Wake-ups travel between threads and, by Redis, between processes; without it one just looks."""

from __future__ import annotations

import asyncio
import threading
import time

import pytest

from services.jobs.events import Events, LocalEvents
from services.jobs.redis_events import RedisEvents
from tests.servers import MortalRedis


def _wakes_a_thread(listening: Events, speaking: Events) -> bool:
    """Whether an event ends a wait that would last a minute."""
    listening.wait("topic", 0.01)  # subscribed from here on
    woken = threading.Event()

    def wait() -> None:
        listening.wait("topic", 0.01)
        listening.wait("topic", 60.0)
        woken.set()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    for _ in range(100):
        speaking.publish("another topic")
        speaking.publish("topic")
        if woken.wait(0.1):
            return True
    return False


def test_an_event_wakes_a_thread():
    events = LocalEvents()
    assert _wakes_a_thread(events, events)


def test_an_event_wakes_another_process_by_redis(redis_url: str):
    listening, speaking = RedisEvents(redis_url), RedisEvents(redis_url)
    assert _wakes_a_thread(listening, speaking)
    listening.close()
    speaking.close()


async def test_no_event_after_listening_is_missed(redis_url: str):
    listening, speaking = RedisEvents(redis_url), RedisEvents(redis_url)
    async with listening.listen("job:1") as listener:
        speaking.publish("job:1")
        await asyncio.wait_for(listener.wait(60.0), 30.0)
    listening.close()
    speaking.close()


async def test_without_redis_everybody_just_looks():
    events = RedisEvents("redis://127.0.0.1:1/0")
    events.publish("topic")
    events.wait("topic", 0.05)
    async with events.listen("topic") as listener:
        await asyncio.wait_for(listener.wait(60.0), 30.0)
    events.close()


async def test_listeners_of_before_and_of_meanwhile_are_woken_once_redis_is_back(
    mortal_redis: MortalRedis, caplog: pytest.LogCaptureFixture
):
    events = RedisEvents(mortal_redis.url)
    async with events.listen("job:1") as before:
        mortal_redis.kill()
        events.publish("job:1")
        async with events.listen("job:1") as meanwhile:
            both = (before, meanwhile)
            for one in both:
                await asyncio.wait_for(one.wait(60.0), 5.0)  # just looks
            mortal_redis.start()
            for one in both:
                await asyncio.wait_for(one.wait(60.0), 5.0)  # subscribed again
            waits = [asyncio.create_task(one.wait(60.0)) for one in both]
            await asyncio.sleep(0.3)
            assert not any(one.done() for one in waits), "nothing has happened yet"
            async with asyncio.timeout(5.0):
                while not all(one.done() for one in waits):
                    events.publish("job:1")
                    await asyncio.sleep(0.1)
    told = [r.getMessage() for r in caplog.records if r.name == "services.redis_outage"]
    assert [words.split(",")[0] for words in told] == ["Redis is away", "Redis is back"]
    events.close()


def test_a_redis_that_hangs_holds_up_whoever_publishes_only_for_a_moment(
    mortal_redis: MortalRedis,
):
    events = RedisEvents(mortal_redis.url)
    events.publish("topic")
    mortal_redis.hang()
    started = time.monotonic()
    for _ in range(20):
        events.publish("topic")
    assert time.monotonic() - started < 2.0
    events.close()


async def test_without_events_between_processes_one_looks_soon():
    async with LocalEvents().listen("topic") as listener:
        await asyncio.wait_for(listener.wait(60.0), 30.0)


def test_waiting_ends_by_itself():
    started = time.monotonic()
    LocalEvents().wait("topic", 0.05)
    assert time.monotonic() - started >= 0.04
