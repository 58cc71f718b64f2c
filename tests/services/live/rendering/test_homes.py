"""The same renderers in both homes: children of this process, and actors of a Ray cluster."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import AsyncIterator, Callable, Iterator

import numpy as np
import pytest

from services.cluster_settings import TaskResources
from services.errors import ServerFull
from services.live.rendering.drawing import FrameRenderer
from services.live.rendering.homes import RendererHome
from services.live.rendering.pool import RendererPool
from services.live.rendering.processes import ProcessHome
from services.live.streaming.pictures import PictureRefused
from services.settings import load_settings
from tests.services.jobs.homes import RayCluster
from tests.services.live.rendering.watching import HalfModel, Watcher, a_room, is_gone, process_of

MakePool = Callable[..., RendererPool]
SHARE = TaskResources(num_cpus=0.5, memory=200_000_000)
_MOST_OFF = 6.0
"""Levels of 255 in the mean, of what video coding leaves."""


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RayCluster]:
    folder = tmp_path_factory.mktemp("cluster")
    made = RayCluster(load_settings(data_dir=folder), folder)
    made.start_head()
    made.add_node(cpus=2)
    yield made
    made.close()


@pytest.fixture(params=["processes", "ray"])
async def make_pool(request: pytest.FixtureRequest) -> AsyncIterator[MakePool]:
    made: list[RendererPool] = []

    def home() -> RendererHome:
        if request.param == "processes":
            return ProcessHome(1)
        from services.live.rendering.ray_home import RayHome

        return RayHome(request.getfixturevalue("cluster").address, SHARE)

    def make(most: int = 1, viewers_each: int = 2, idle_s: float = 60.0) -> RendererPool:
        pool = RendererPool(
            home(), time.monotonic, most=most, viewers_each=viewers_each, idle_s=idle_s
        )
        made.append(pool)
        return pool

    yield make
    for pool in made:
        await pool.close()


async def until(fits: Callable[[], bool], what: str) -> None:
    for _ in range(1800):
        if fits():
            return
        await asyncio.sleep(0.1)
    raise AssertionError(f"{what} did not come")


async def test_a_room_is_drawn_as_here_and_one_that_cannot_be_disturbs_nobody(make_pool: MakePool):
    pool, room = make_pool(viewers_each=3, idle_s=1.0), a_room()
    ada, ben = Watcher(pool, room), Watcher(pool, room)
    assert ada.slot is ben.slot
    shown = await ada.shown()
    order = ada.order(tick=0)
    plain = FrameRenderer().render(room.scene_at(order.now_s), order.camera)
    assert np.abs(shown - plain.to_ndarray(format="rgb24")).mean() < _MOST_OFF
    assert [(await ada.packet()).is_keyframe for _ in range(2)] == [False, False]
    assert (await ben.packet()).is_keyframe

    broken = Watcher(pool, a_room(HalfModel.made(), name="other"))
    with pytest.raises(PictureRefused, match=r"must hold a whole model"):
        await broken.packet()
    assert not (await ada.packet()).is_keyframe
    assert ada.slot is broken.slot

    # somebody more comes, and is seen once they were read
    before = await ada.shown()
    room.performers = a_room(*(one.model for one in room.performers * 2)).performers
    for _ in range(300):
        if np.abs(await ada.shown() - before).mean() > 2.0 * _MOST_OFF:
            break
    else:
        raise AssertionError("who came is not seen")
    process = await process_of(ada.slot)
    for one in (ada, ben, broken):
        one.pictures.close()
    await until(lambda: len(pool) == 0, "the end of all")
    await until(lambda: is_gone(process), "the end of its process")


async def test_who_is_killed_is_replaced_by_who_waited_and_pictures_begin_anew(
    make_pool: MakePool,
):
    pool = make_pool()
    ada = Watcher(pool, a_room())
    await ada.packet()
    await until(lambda: len(pool.ready_slots) == 2, "the one that waits")
    first = ada.slot
    killed = await process_of(first)
    os.kill(killed, signal.SIGKILL)
    packets = [await ada.packet() for _ in range(3)]
    assert [one.is_keyframe for one in packets] == [True, False, False]
    assert ada.slot is not first
    await until(lambda: first.ready, "the killed one")
    assert await process_of(first) != killed
    # one that waits is missed too
    os.kill(await process_of(first), signal.SIGKILL)
    await until(lambda: not first.ready, "a look at who waits")
    await until(lambda: first.ready, "the one that waited")
    assert not (await ada.packet()).is_keyframe


async def test_the_full_refuse_newcomers_and_with_nobody_left_nothing_is(make_pool: MakePool):
    pool, room = make_pool(viewers_each=1, idle_s=1.0), a_room()
    ada = Watcher(pool, room)
    with pytest.raises(ServerFull, match="at most 1 renderers draw here, each for 1 viewers"):
        Watcher(pool, room)
    await ada.packet()
    process = await process_of(ada.slot)
    ada.pictures.rest()
    ben = Watcher(pool, room)
    await ben.packet()
    # who is inside comes back in any case
    assert (await ada.packet()).is_keyframe
    for one in (ada, ben):
        one.pictures.close()
    await until(lambda: len(pool) == 0, "the end of all")
    await until(lambda: is_gone(process), "the end of its process")
    cleo = Watcher(pool, room)
    assert (await cleo.packet()).is_keyframe
