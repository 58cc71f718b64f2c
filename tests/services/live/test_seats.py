"""Seats and places on the server come back however a viewer goes: by real WebRTC connections."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from db.models import ModelRow
from scene import Environment
from services import seats
from services.app import create_app
from services.container import Services
from services.errors import TooManyRequests
from services.gateway import gateway_of
from services.live.rendering.here import RenderersHere
from services.live.sessions.view_session import CONNECT_S, SILENCE_S, ViewSession
from services.live.sessions.view_sessions import ViewSessions
from tests.fakes import Clock
from tests.services import seeds
from tests.services.conftest import bearer
from tests.services.live.viewer import Viewer, view


class Seconds:
    """A monotonic clock that can be put forward."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class EmptyMeetings:
    """Meetings without performers, whose seats are only noted."""

    def __init__(self) -> None:
        self.kept: list[set[str]] = []
        self.given_back: list[set[str]] = []

    async def performers(self, meeting_id: str) -> tuple:
        return ()

    async def environment(self, meeting_id: str) -> Environment:
        return Environment()

    async def sealed(self, meeting_id: str) -> bool:
        return False

    async def renew_seats(self, participant_ids: set[str]) -> None:
        self.kept.append(participant_ids)

    async def release_seats(self, participant_ids: set[str]) -> None:
        self.given_back.append(participant_ids)


@pytest.fixture
def model(services: Services, model_file: Path) -> ModelRow:
    return seeds.imported(services, model_file, "house", "Ada")


@pytest.fixture
async def meeting_id(caller: httpx.AsyncClient, model: ModelRow) -> str:
    body = {"name": "Monday", "model_ids": [model.id]}
    return (await caller.post("/v1/meetings", json=body)).json()["id"]


async def _join(caller: httpx.AsyncClient, meeting_id: str) -> tuple[int, dict[str, str]]:
    """A seat's number, and the header of whoever has it."""
    seat = (await caller.post(f"/v1/meetings/{meeting_id}/join", json={})).json()
    return seat["seat"], {"Authorization": f"Bearer {seat['token']}"}


def _taken(services: Services, meeting_id: str) -> list[int]:
    with services.reading() as unit:
        return [one.seat for one in unit.meetings.get(meeting_id).participants]


async def _soon(look: Callable[[], bool], what: str, timeout_s: float = 20.0) -> None:
    for _ in range(round(timeout_s / 0.05)):
        if look():
            return
        await asyncio.sleep(0.05)
    raise AssertionError(f"{what} did not happen within {timeout_s:g} s")


@pytest.mark.parametrize("goodbye", ["asked", "closed"])
async def test_leaving_gives_the_seat_back(app, caller, services, meeting_id, goodbye):
    (first, mine), (second, _) = [await _join(caller, meeting_id) for _ in range(2)]
    assert (first, second) == (1, 2)
    viewer = Viewer()
    answer = await viewer.look(caller, meeting_id, mine)
    await viewer.opened()
    assert (await viewer.frame()).size > 0
    if goodbye == "asked":
        await caller.delete(answer.headers["location"], headers=mine)
    await viewer.peer.close()
    await _soon(lambda: len(gateway_of(app).views) == 0, "the end of the session")
    await _soon(lambda: _taken(services, meeting_id) == [2], "giving the seat back")
    late = await Viewer().look(caller, meeting_id, mine)
    assert late.status_code == 403
    assert "join the meeting again" in late.json()["detail"]
    assert (await _join(caller, meeting_id))[0] == 1


async def test_an_offer_that_fails_gives_the_seat_back(app, caller, services, meeting_id):
    _, mine = await _join(caller, meeting_id)
    headers = mine | {"Content-Type": "application/sdp"}
    answer = await caller.post(f"/whep/{meeting_id}", content=b"v=0 nonsense", headers=headers)
    assert answer.status_code == 422
    assert (len(gateway_of(app).views), _taken(services, meeting_id)) == (0, [])


async def test_who_comes_back_while_their_view_before_ends_keeps_the_seat(
    app, caller, services, meeting_id, monkeypatch: pytest.MonkeyPatch
):
    _, mine = await _join(caller, meeting_id)
    before, after = Viewer(), Viewer()
    location = (await before.look(caller, meeting_id, mine)).headers["location"]
    views, homes = gateway_of(app).views, gateway_of(app).homes
    is_looked_at, goes_on = threading.Event(), threading.Event()
    require_here = homes.require_here

    def require_here_slowly(asked_id: str, path: str) -> None:
        is_looked_at.set()
        assert goes_on.wait(20.0)
        require_here(asked_id, path)

    monkeypatch.setattr(type(homes), "require_here", lambda _, *asked: require_here_slowly(*asked))
    coming = asyncio.create_task(after.look(caller, meeting_id, mine))
    await _soon(is_looked_at.is_set, "the look at the seat")
    assert (await caller.delete(location, headers=mine)).status_code == 200
    goes_on.set()
    assert (await coming).status_code == 201
    await after.opened()
    assert _taken(services, meeting_id) == [1]
    assert len(views) == 1
    await after.peer.close()
    await _soon(lambda: _taken(services, meeting_id) == [], "giving the seat back")
    await before.peer.close()


async def test_who_asks_for_a_view_and_gets_none_gives_the_seat_back_with_the_last_one(watched):
    views, _, noted = watched
    viewer = Viewer()
    session_id, _ = await views.open("m", await viewer.offer(), "seat")
    async with views.arriving("seat"):
        async with views.arriving("seat"):
            await views.close(session_id)
        assert noted.given_back == []
    assert noted.given_back == [{"seat"}]
    async with views.arriving("seat"):
        pass
    assert noted.given_back == [{"seat"}]
    await viewer.peer.close()


async def test_who_never_comes_to_look_loses_the_seat(services, model):
    clock = Clock()
    late = replace(services, clock=clock)
    transport = httpx.ASGITransport(create_app(late))
    async with httpx.AsyncClient(
        transport=transport, base_url="http://test", headers=bearer(services)
    ) as caller:
        body = {"name": "Monday", "model_ids": [model.id]}
        meeting_id = (await caller.post("/v1/meetings", json=body)).json()["id"]
        await _join(caller, meeting_id)
        clock.advance(seconds=seats.SEAT_LAPSES_S)
        assert (await _join(caller, meeting_id))[0] == 2
        with late.reading() as unit:
            (_, watched) = [one.id for one in unit.meetings.get(meeting_id).participants]
        clock.advance(seconds=20)
        assert seats.renew_seats(late, {watched, "nobody's"}) == {watched}
        clock.advance(seconds=20)
        assert (await _join(caller, meeting_id))[0] == 1
    assert _taken(services, meeting_id) == [1, 2]


async def test_a_meeting_with_every_seat_taken_says_when_to_come_back(
    caller, meeting_id, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(seats, "MOST_SEATS", 1)
    await _join(caller, meeting_id)
    answer = await caller.post(f"/v1/meetings/{meeting_id}/join", json={})
    assert answer.status_code == 503
    assert int(answer.headers["retry-after"]) > 0
    assert "at most 1 viewers; got one more" in answer.json()["detail"]


@pytest.fixture
async def watched() -> AsyncIterator[tuple[ViewSessions, Seconds, EmptyMeetings]]:
    clock, noted = Seconds(), EmptyMeetings()
    views = ViewSessions(
        noted, clock, RenderersHere(clock), ice_servers=[], max_viewers=2, describe_error=str
    )
    yield views, clock, noted
    await views.close_all()


async def test_an_answer_that_nobody_takes_up_frees_its_place(watched):
    views, clock, noted = watched
    viewer = Viewer()
    await views.open("m", await viewer.offer(), "seat")
    await asyncio.sleep(0)  # the monitor begins
    clock.now_s += CONNECT_S - 1.0
    # seats are renewed after everybody was looked at
    await _soon(lambda: noted.kept == [{"seat"}], "a look at who has left")
    assert len(views) == 1
    clock.now_s += 2.0
    await _soon(lambda: noted.given_back == [{"seat"}], "giving back a seat that nobody took up")
    assert len(views) == 0
    await viewer.peer.close()


async def test_nobody_takes_all_places_by_one_seat():
    clock, noted = Seconds(), EmptyMeetings()
    views = ViewSessions(
        noted, clock, RenderersHere(clock), ice_servers=[], max_viewers=9, describe_error=str
    )
    viewers = [Viewer() for _ in range(6)]
    offers = [await viewer.offer() for viewer in viewers]
    opened = [(await views.open("m", offer, "seat"))[0] for offer in offers[:4]]
    opened.append((await views.open("m", offers[4], "another"))[0])
    # the newest stay, and the seat is still theirs
    assert [views.find(one) is not None for one in opened] == [False, True, True, True, True]
    assert noted.given_back == []
    # who has no seat is told apart by what the route says of them
    for _ in range(3):
        await views.open("m", offers[5], onlooker="ada")
    with pytest.raises(TooManyRequests, match="at most 3 at once of one caller; got one more"):
        await views.open("m", offers[5], onlooker="ada")
    await views.open("m", offers[5], onlooker="bo")
    assert len(views) == 8
    await views.close_all()
    for viewer in viewers:
        await viewer.peer.close()


async def test_a_viewer_fallen_silent_is_gone_and_one_seat_may_have_two_sessions(watched):
    views, clock, noted = watched
    lost, back = Viewer(), Viewer()
    opened: list[ViewSession | None] = []
    for viewer in (lost, back):
        session_id, answer = await views.open("m", await viewer.offer(), "seat")
        opened.append(views.find(session_id))
        await viewer.accept(answer)
        await viewer.opened()
    # the same seat: the connection that was lost and the one that came after it
    lost.channel.send(view(1, 0.0, 3.0))
    await _soon(lambda: any(s and s.last_message_s is not None for s in opened), "hearing")
    clock.now_s += SILENCE_S + 1.0
    await _soon(lambda: len(views) == 1, "dropping the silent")
    assert noted.given_back == []
    clock.now_s += seats.BEAT_S
    await _soon(lambda: noted.kept == [{"seat"}], "keeping the seat")
    await back.peer.close()
    await _soon(lambda: noted.given_back == [{"seat"}], "giving it back")
    await lost.peer.close()
