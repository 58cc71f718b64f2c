"""Where meetings live: chosen once, by room, and anew where a gateway died or drains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from db.errors import NotFound
from db.models import GatewayRow
from services import meetings
from services.composition import build_services
from services.container import Services
from services.errors import Draining, LivesElsewhere, ServerFull
from services.homes import LEASE_S, NOWHERE, Homes, least_loaded_of_two
from services.settings import Settings
from tests.fakes import Clock
from tests.servers import DATABASES, fresh_database, make_schema
from tests.services.conftest import changed

ONE, TWO, THREE = (f"https://{name}.example" for name in ("one", "two", "three"))


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(params=DATABASES)
def shared(
    request: pytest.FixtureRequest,
    settings: Settings,
    clock: Clock,
    tmp_path: Path,
    empty_database: Path,
) -> Iterator[Services]:
    with fresh_database(request.param, tmp_path) as url:
        made = build_services(changed(settings, database_url=url), clock=clock)
        make_schema(made.database, empty_database)
        yield made
        made.close()


Gateways = Callable[..., Homes]


@pytest.fixture
def gateway(shared: Services) -> Gateways:
    """Makes a gateway at an address, with room for so many, whose lease begins."""

    def make(url: str, free: int = 8) -> Homes:
        own = replace(shared, settings=changed(shared.settings, gateway_url=url))
        homes = Homes(own, lambda: free, Random(0))
        homes.renew()
        return homes

    return make


@pytest.fixture
def meeting_id(shared: Services) -> str:
    return opened(shared)


def opened(services: Services) -> str:
    with services.unit_of_work() as unit:
        made = meetings.create_meeting(services, unit, "house", "Monday", [])
        unit.commit()
    return made.id


def test_the_first_to_ask_chooses_for_all(gateway: Gateways, meeting_id: str):
    one, two = gateway(ONE), gateway(TWO)
    home = one.find(meeting_id)
    assert home == two.find(meeting_id) == gateway("").find(meeting_id)
    here, elsewhere = (one, two) if home.gateway_id == one.id else (two, one)
    here.require_here(meeting_id, "/whep/m")
    with pytest.raises(LivesElsewhere) as sent:
        elsewhere.require_here(meeting_id, "/whep/m")
    assert sent.value.address == f"{home.url}/whep/m"


def test_many_who_ask_at_once_are_sent_to_one(gateway: Gateways, meeting_id: str):
    gateways = [gateway(url) for url in (ONE, TWO, THREE)]
    with ThreadPoolExecutor(6) as threads:
        found = threads.map(lambda homes: homes.find(meeting_id), 4 * gateways)
        assert len(set(found)) == 1


def test_of_two_gateways_the_one_with_more_room_is_chosen(gateway: Gateways, shared: Services):
    def row(name: str, free: int) -> GatewayRow:
        return GatewayRow(id=name, free=free)

    rows = [row("full", 1), row("half", 4), row("empty", 8)]
    drawn = Counter(least_loaded_of_two(rows, Random(seed)).id for seed in range(300))
    assert set(drawn) == {"half", "empty"}  # of any two, the fullest of all is never the roomier
    assert drawn["empty"] > drawn["half"]
    small, large = gateway(ONE, free=1), gateway(TWO, free=7)
    assert {small.find(opened(shared)).gateway_id for _ in range(5)} == {large.id}


def test_meetings_that_begin_at_one_moment_are_spread(gateway: Gateways, shared: Services):
    gateways = [gateway(ONE, free=20), gateway(TWO, free=20)]
    homes = Counter(gateways[0].find(opened(shared)).gateway_id for _ in range(5))
    for one in gateways:
        one.renew()  # nobody has come yet
    homes += Counter(gateways[1].find(opened(shared)).gateway_id for _ in range(5))
    assert sorted(homes.values()) == [5, 5]


def test_a_place_that_was_promised_is_free_again_if_nobody_comes(
    gateway: Gateways, shared: Services
):
    one = gateway(ONE, free=3)
    for _ in range(3):
        one.find(opened(shared))
    with pytest.raises(ServerFull):
        one.find(opened(shared))
    for _ in range(5):
        one.renew()
    with shared.reading() as unit:
        assert unit.gateways.free_places(one.id) == 3


def test_a_gateway_without_room_is_nobodys_new_home(gateway: Gateways, shared: Services):
    full, roomy = gateway(ONE, free=0), gateway(TWO, free=1)
    meeting_id = opened(shared)
    assert full.find(meeting_id).gateway_id == roomy.id
    with shared.unit_of_work() as unit:
        unit.gateways.forget(roomy.id)
        unit.commit()
    with pytest.raises(ServerFull, match="got 1 that are full"):
        full.find(meeting_id)


def test_a_home_whose_lease_ends_is_replaced_and_gives_way_once_it_is_back(
    gateway: Gateways, shared: Services, clock: Clock, meeting_id: str
):
    one = gateway(ONE)
    assert one.find(meeting_id).gateway_id == one.id
    clock.advance(seconds=LEASE_S - 0.5)
    two = gateway(TWO)
    assert two.find(meeting_id).gateway_id == one.id
    clock.advance(seconds=1.0)
    with shared.reading() as unit:
        assert not one.has_moved(unit, unit.meetings.get(meeting_id))
    assert two.find(meeting_id).gateway_id == two.id
    one.renew()
    assert one.find(meeting_id).gateway_id == two.id
    with shared.reading() as unit:
        assert one.has_moved(unit, unit.meetings.get(meeting_id))
        assert not two.has_moved(unit, unit.meetings.get(meeting_id))


def test_nobody_is_sent_to_a_gateway_that_drains(gateway: Gateways, meeting_id: str):
    one = gateway(ONE)
    assert one.find(meeting_id).gateway_id == one.id
    one.draining = True
    one.renew()
    for ask in (one.find, lambda meeting_id: one.require_here(meeting_id, "/")):
        with pytest.raises(Draining) as told:
            ask(meeting_id)
        assert told.value.retry_after_s == 1
    two = gateway(TWO)
    assert one.find(meeting_id).gateway_id == two.find(meeting_id).gateway_id == two.id


def test_without_addresses_each_gateway_serves_whoever_comes(gateway: Gateways, meeting_id: str):
    for homes in (gateway(""), gateway("")):
        assert homes.find(meeting_id) == NOWHERE
        homes.require_here(meeting_id, "/whep/m")
        assert homes.origins() == frozenset()
    with pytest.raises(NotFound):
        gateway("").find("none")


def test_pages_of_every_gateway_and_of_the_common_address_may_come(
    shared: Services, gateway: Gateways
):
    one = gateway(ONE)
    gateway(TWO)
    one.renew()
    assert one.origins() == {ONE, TWO}
    public = changed(
        shared.settings, gateway_url=THREE, public_url="https://meet.example.org/base/"
    )
    three = Homes(replace(shared, settings=public), lambda: 1)
    three.renew()
    assert three.origins() == {ONE, TWO, THREE, "https://meet.example.org"}
