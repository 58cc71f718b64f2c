"""Whoever drives from the command line follows a meeting from gateway to gateway on one seat."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, replace
from datetime import timedelta
from itertools import count
from pathlib import Path

import httpx
import pytest

from benchmarks.servers import MortalServer, gateway_at
from services.auth import ALL_SCOPES
from services.bootstrap import DEMO_MODEL
from services.composition import build_services
from services.container import Services
from services.joining.presence import Presence, present
from services.joining.seat import MeetingAway, MeetingLink, NotJoined, Seat, take_seat
from services.meetings import create_meeting
from services.settings import load_settings
from tests.capture.people import standing
from tests.e2e.turns import turns
from tests.servers import free_port
from tests.services import seeds
from tests.services.live.people import seen

PATIENCE_S = 90.0


@dataclass(frozen=True)
class House:
    """Two gateways behind an address that sends each request to either, and a meeting."""

    common: str
    gateways: dict[str, MortalServer]
    """By their own addresses; not started."""
    services: Services
    meeting_id: str

    def seat(self) -> Seat:
        """Ada's, to drive her own model."""
        token, _ = self.services.tokens.issue("ada", ALL_SCOPES, timedelta(hours=1))
        link = MeetingLink(self.common, self.meeting_id, None)
        return take_seat(link, token, "Ada", None, live_look=False)

    def seats_taken(self) -> list[str]:
        with self.services.reading() as unit:
            return [one.id for one in unit.meetings.get(self.meeting_id).participants]


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    ports = [free_port() for _ in range(2)]
    with ExitStack() as stack:
        common = stack.enter_context(turns(ports)).address
        settings = load_settings(
            data_dir=tmp_path / "data", embedded_worker=False, public_url=common
        )
        services = build_services(settings)
        stack.callback(services.close)
        services.database.migrate()
        ada = seeds.imported(services, DEMO_MODEL, "ada", "Ada")
        with services.unit_of_work() as unit:
            meeting = create_meeting(services, unit, "ada", "Monday", [ada])
            unit.commit()
        urls = [f"http://127.0.0.1:{port}" for port in ports]
        made = {url: gateway_at(url, settings.child_environment()) for url in urls}
        for one in made.values():
            stack.callback(one.kill)
        yield House(common, made, services, meeting.id)


async def stand(visit: Presence) -> None:
    """Ten packets a second, as long as they are taken."""
    pose = standing(2).pose(0)
    for number in count(1):
        visit.send(seen(replace(pose, time_s=0.1 * number), number))
        await asyncio.sleep(0.1)


@asynccontextmanager
async def moving(visit: Presence) -> AsyncIterator[None]:
    """Ada stands there."""

    sending = asyncio.create_task(stand(visit))
    yield
    assert not sending.done(), "Ada was sent out"
    sending.cancel()


async def solved_at(url: str) -> float:
    """How many packets the gateway has made poses of."""
    async with httpx.AsyncClient() as caller:
        for line in (await caller.get(f"{url}/metrics")).text.splitlines():
            if line.startswith('metanerf_keypoints_total{outcome="solved"}'):
                return float(line.split()[-1])
    return 0.0


async def until(fits: Callable[[], bool], what: str) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not fits():
            await asyncio.sleep(0.1)


async def test_a_drained_and_a_killed_gateway_are_left_for_the_next(house: House):
    for one in house.gateways.values():
        one.start()
    seat = await asyncio.to_thread(house.seat)
    (taken,) = house.seats_taken()
    async with present(seat, live_look=False) as visit, moving(visit):
        first = visit.home
        (second,) = set(house.gateways) - {first}
        async with asyncio.timeout(PATIENCE_S):
            while await solved_at(first) == 0.0:
                await asyncio.sleep(0.2)

        await asyncio.to_thread(house.gateways[first].end, 60.0)
        await until(lambda: visit.home == second, "the move from a gateway that drained")
        async with asyncio.timeout(PATIENCE_S):
            while await solved_at(second) == 0.0:
                await asyncio.sleep(0.2)
        assert house.seats_taken() == [taken]

        house.gateways[first].start(wait=False)
        await asyncio.to_thread(house.gateways[first].wait)
        house.gateways[second].kill()
        await until(lambda: visit.home == first, "the move from a gateway that died")
        async with asyncio.timeout(PATIENCE_S):
            while await solved_at(first) == 0.0:
                await asyncio.sleep(0.2)
        assert house.seats_taken() == [taken]
    await until(lambda: house.seats_taken() == [], "giving the seat back")


async def test_whoever_was_sent_out_does_not_come_again(house: House):
    one, two = house.gateways.values()
    one.start()
    seat = await asyncio.to_thread(house.seat)
    async with present(seat, live_look=False) as visit:
        with house.services.unit_of_work() as unit:
            meeting = unit.meetings.get(house.meeting_id)
            meeting.ended_at = house.services.clock()
            unit.commit()
        two.start()
        one.kill()
        with pytest.raises(NotJoined) as told:
            await asyncio.wait_for(stand(visit), PATIENCE_S)
        assert not isinstance(told.value, MeetingAway)
