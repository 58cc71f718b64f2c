"""Turns at looking at files go round between those who send them."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator

import pytest

from services.errors import Unavailable
from services.uploads.turns import AT_ONCE, MOST_OF_ONE_WAITING, MOST_WAITING, Turns


class Looks:
    """Looks that last until they are let go, in the order in which they began."""

    def __init__(self) -> None:
        self.begun: list[str] = []
        self._ends: dict[str, threading.Event] = {}

    def look(self, name: str) -> str:
        """One look. On a thread."""
        self._ends[name] = threading.Event()
        self.begun.append(name)
        assert self._ends[name].wait(30.0)
        return name

    def end(self, *names: str) -> None:
        """Have these end."""
        for name in names:
            self._ends[name].set()

    def end_all(self) -> None:
        """Have all end that have begun."""
        self.end(*self._ends)


@pytest.fixture
def looks() -> Iterator[Looks]:
    made = Looks()
    yield made
    made.end_all()


async def _send(turns: Turns, looks: Looks, *names: str) -> list[asyncio.Task[str]]:
    """Files, each by its sender's letter and a number, in this order."""
    sent = []
    for name in names:
        sent.append(asyncio.create_task(turns.run(name[0], looks.look, name)))
        await asyncio.sleep(0)
    return sent


async def _under_way(looks: Looks, *names: str) -> None:
    async with asyncio.timeout(30):
        while len(looks.begun) < len(names):
            await asyncio.sleep(0.01)
    assert sorted(looks.begun) == sorted(names)  # threads of one moment begin as they like


async def test_who_sends_many_files_holds_up_nobody_who_sends_one(looks: Looks):
    turns = Turns()
    sent = await _send(turns, looks, "a1", "a2", "a3", "a4", "a5", "b1", "c1")
    await _under_way(looks, "a1", "a2")
    assert turns.waiting == 5
    looks.end("a1")
    await _under_way(looks, "a1", "a2", "b1")
    looks.end("a2")
    await _under_way(looks, "a1", "a2", "b1", "c1")
    # nobody else waits: they may have all turns again
    looks.end("b1")
    await _under_way(looks, "a1", "a2", "b1", "c1", "a3")
    looks.end("c1")
    await _under_way(looks, "a1", "a2", "b1", "c1", "a3", "a4")
    looks.end("a3", "a4")
    await _under_way(looks, "a1", "a2", "b1", "c1", "a3", "a4", "a5")
    looks.end("a5")
    assert await asyncio.gather(*sent) == ["a1", "a2", "a3", "a4", "a5", "b1", "c1"]
    assert turns.waiting == 0


async def test_two_who_send_many_files_have_turns_one_after_the_other(looks: Looks):
    turns = Turns()
    sent = await _send(turns, looks, "z1", "z2", "a1", "a2", "a3", "b1", "b2", "b3")
    expected = ["z1", "z2"]
    await _under_way(looks, *expected)
    for ended, follows in zip(
        ("z1", "z2", "a1", "b1", "a2", "b2"), ("a1", "b1", "a2", "b2", "a3", "b3"), strict=True
    ):
        looks.end(ended)
        expected.append(follows)
        await _under_way(looks, *expected)
    looks.end_all()
    await asyncio.gather(*sent)


async def test_no_one_takes_all_places_in_which_files_wait(looks: Looks):
    turns = Turns()
    numbers = range(AT_ONCE + MOST_OF_ONE_WAITING)
    sent = await _send(turns, looks, *(f"a{number}" for number in numbers))
    with pytest.raises(Unavailable, match=f"{MOST_OF_ONE_WAITING} of one account; got one more"):
        await turns.run("a", looks.look, "a-too-many")
    others = [f"{chr(ord('b') + n)}0" for n in range(MOST_WAITING - MOST_OF_ONE_WAITING)]
    sent += await _send(turns, looks, *others)
    assert turns.waiting == MOST_WAITING
    with pytest.raises(Unavailable, match=f"at most {MOST_WAITING} files may wait"):
        await turns.run("z", looks.look, "z0")
    async with asyncio.timeout(30):
        while not all(one.done() for one in sent):
            looks.end_all()
            await asyncio.sleep(0.01)


async def test_whoever_goes_away_leaves_their_turn_to_others(looks: Looks):
    turns = Turns()
    waiting: list[asyncio.Task[str]] = []

    async def look_then_have_the_next_go_away() -> str:
        looked = await turns.run("a", looks.look, "a1")
        waiting[1].cancel()  # who has been given the turn just now, and does not know yet
        return looked

    first = asyncio.create_task(look_then_have_the_next_go_away())
    sent = await _send(turns, looks, "a2")
    await _under_way(looks, "a1", "a2")
    waiting += await _send(turns, looks, "b1", "c1", "d1")
    waiting[0].cancel()  # while it waits
    await asyncio.wait([waiting[0]])
    assert turns.waiting == 2
    looks.end("a1")
    await _under_way(looks, "a1", "a2", "d1")
    assert waiting[1].cancelled()
    looks.end("a2", "d1")
    assert await asyncio.gather(first, *sent, waiting[2]) == ["a1", "a2", "d1"]


async def test_a_look_that_fails_gives_its_turn_back(looks: Looks):
    turns = Turns()

    def fail() -> None:
        raise ValueError("no clip")

    for _ in range(AT_ONCE + 1):
        with pytest.raises(ValueError, match="no clip"):
            await turns.run("a", fail)
    sent = await _send(turns, looks, "a1", "a2")
    await _under_way(looks, "a1", "a2")
    looks.end_all()
    await asyncio.gather(*sent)
