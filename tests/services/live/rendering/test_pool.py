"""Placing viewers: by room and free capacity, and what becomes of them in bad weather.

Renderers are stages of this process, which can be lost as they are told.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator

import pytest

from services.errors import RenderersAway, ServerFull
from services.live.rendering.homes import Renderer, RendererGone, RendererHome
from services.live.rendering.pool import RendererPool
from services.live.rendering.stage import RenderStage
from tests.renderer.studio import make_model
from tests.services.live.rendering.watching import Watcher, a_room


class Clock:
    """Moves when it is told to."""

    now_s = 50.0

    def __call__(self) -> float:
        return self.now_s


class StageHere(Renderer):
    """A stage of this process."""

    def __init__(self, home: HomeHere) -> None:
        self._home = home
        self.stage: RenderStage | None = None

    async def start(self) -> None:
        if self._home.away:
            raise RendererGone("a node must be there; got none; add one")
        self.stage = RenderStage()

    async def draw(self, request: bytes) -> bytes:
        await asyncio.sleep(0)
        if self.stage is None:
            raise RendererGone("a renderer must run; got none")
        return self.stage.answer(request)

    async def load(self, request: bytes) -> bytes:
        return await self.draw(request)

    async def end(self) -> None:
        self.stage = None


class HomeHere(RendererHome):
    """Which may be away."""

    away = False

    def renderer(self) -> StageHere:
        return StageHere(self)

    async def close(self) -> None:
        pass


@pytest.fixture
def home() -> HomeHere:
    return HomeHere()


@pytest.fixture
async def pool(home: HomeHere) -> AsyncIterator[RendererPool]:
    made = RendererPool(home, Clock(), most=3, viewers_each=4, idle_s=60.0)
    yield made
    await made.close()


def places(watchers: list[Watcher]) -> Counter[int]:
    return Counter(id(one.slot) for one in watchers)


async def newcomers(pool: RendererPool) -> None:
    """One after the other, each of whom leaves at once."""
    for _ in range(200):
        Watcher(pool, a_room()).pictures.close()
        await asyncio.sleep(0.01)


async def test_viewers_of_a_room_share_a_renderer_until_it_is_full_and_then_the_next(
    pool: RendererPool,
):
    room = a_room()
    watchers = [Watcher(pool, room) for _ in range(6)]
    assert sorted(places(watchers).values()) == [2, 4]
    assert len(pool) == 3  # one waits
    watchers += [Watcher(pool, room) for _ in range(6)]
    assert sorted(places(watchers).values()) == [4, 4, 4]
    with pytest.raises(ServerFull, match="got one viewer more"):
        Watcher(pool, room)
    assert len(pool) == 4
    watchers.pop().pictures.close()
    Watcher(pool, room)


async def test_of_two_renderers_the_one_with_more_room_is_taken(pool: RendererPool):
    rooms = [a_room(name=str(number)) for number in range(3)]
    full = [Watcher(pool, rooms[0]) for _ in range(4)]
    half = [Watcher(pool, rooms[1]) for _ in range(3)]
    full.pop().pictures.close()
    full.pop().pictures.close()
    newcomer = Watcher(pool, rooms[2])
    assert newcomer.slot is full[0].slot
    assert newcomer.slot is not half[0].slot


async def test_who_is_busy_takes_nobody_more(pool: RendererPool):
    first = Watcher(pool, a_room())
    await first.packet()
    first.slot.note(3.9)  # of the last four seconds
    assert Watcher(pool, a_room(name="other")).slot is not first.slot


async def test_one_that_began_anew_without_a_word_is_told_all_again(pool: RendererPool):
    watcher = Watcher(pool, a_room())
    assert [(await watcher.packet()).is_keyframe for _ in range(2)] == [True, False]
    renderer = watcher.slot.renderer
    assert isinstance(renderer, StageHere)
    renderer.stage = RenderStage()
    assert [(await watcher.packet()).is_keyframe for _ in range(2)] == [True, False]


async def test_what_no_viewer_needs_is_forgotten(pool: RendererPool):
    ada, ben = Watcher(pool, a_room()), Watcher(pool, a_room(name="other"))
    for one in (ada, ben):
        await one.packet()
    assert ada.slot is ben.slot
    renderer = ada.slot.renderer
    assert isinstance(renderer, StageHere)
    assert renderer.stage is not None
    assert renderer.stage.held == {"rooms": 2, "viewers": 2, "models": 2}
    ada.pictures.rest()
    await ben.packet()
    assert renderer.stage.held == {"rooms": 1, "viewers": 1, "models": 1}


async def test_who_is_taken_out_of_a_room_is_forgotten(pool: RendererPool):
    room = a_room(make_model(), make_model())
    watcher = Watcher(pool, room)
    await watcher.packet()
    renderer = watcher.slot.renderer
    assert isinstance(renderer, StageHere)
    assert renderer.stage is not None
    assert renderer.stage.held["models"] == 2
    room.performers = room.performers[:1]  # as erasure does: their seat goes
    async with asyncio.timeout(60.0):
        while renderer.stage.held != {"rooms": 1, "viewers": 1, "models": 1}:
            await watcher.packet()


async def test_a_home_that_is_away_is_told_in_words_until_it_is_back(
    pool: RendererPool, home: HomeHere
):
    home.away = True
    waiting = Watcher(pool, a_room())
    coming = asyncio.create_task(waiting.packet())
    with pytest.raises(RenderersAway, match="a node must be there"):
        await newcomers(pool)
    home.away = False
    assert (await coming).is_keyframe
