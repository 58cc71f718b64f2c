"""Renderers that are child processes: hung ones are killed, and none outlives its gateway."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from services.live.rendering.pool import RendererPool
from services.live.rendering.processes import ProcessHome
from tests.services.jobs.waiting import until
from tests.services.live.rendering.watching import Watcher, a_room, is_gone, process_of

HOLDER = """
import asyncio, time
from services.live.rendering.processes import ProcessHome

async def hold():
    renderers = [ProcessHome(1).renderer() for _ in range(2)]
    await renderers[0].start()
    starting = asyncio.create_task(renderers[1].start())
    while renderers[1].process_id is None:
        await asyncio.sleep(0.01)
    print(*(one.process_id for one in renderers), flush=True)
    await asyncio.sleep(600.0)

asyncio.run(hold())
"""


@pytest.fixture
def holder() -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen([sys.executable, "-c", HOLDER], stdout=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.wait()


def test_the_warm_and_the_starting_end_with_a_killed_gateway(holder: subprocess.Popen[str]):
    assert holder.stdout is not None
    renderers = [int(word) for word in holder.stdout.readline().split()]
    assert len(renderers) == 2
    assert not any(map(is_gone, renderers))
    holder.kill()
    until(lambda: all(map(is_gone, renderers)), "the end of its renderers")


async def test_one_that_hangs_is_killed_and_another_draws():
    home = ProcessHome(1, silent_s=3.0)
    pool = RendererPool(home, time.monotonic, most=1, viewers_each=1, idle_s=60.0)
    watcher = Watcher(pool, a_room())
    await watcher.packet()
    hung = await process_of(watcher.slot)
    os.kill(hung, signal.SIGSTOP)
    assert (await watcher.packet()).is_keyframe
    until(lambda: is_gone(hung), "the end of the one that hangs")
    await pool.close()
