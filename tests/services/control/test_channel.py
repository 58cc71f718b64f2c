"""The control channel with a real server and real WebSockets: talk, come back, go silent."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import timedelta

import pytest

from services.app import create_app
from services.auth import ALL_SCOPES
from services.container import Services
from services.control.roster import SILENCE_S
from services.gateway import COMMANDS_PER_MINUTE, gateway_of
from services.jobs.redis_events import RedisEvents
from services.limits import RateLimit
from services.seats import SEAT_LAPSES_S
from tests.fakes import Clock
from tests.services.control.conftest import on_a_port
from tests.services.control.page import Page, join


def header(services: Services, account: str) -> dict[str, str]:
    token, _ = services.tokens.issue(account, ALL_SCOPES, timedelta(hours=1))
    return {"Authorization": f"Bearer {token}"}


async def test_two_people_see_each_other_and_talk(caller, timed, meeting):
    bo_header = header(timed, "neighbours")
    async with await join(caller, meeting["id"], "Ada") as ada:
        welcome = await ada.hear("welcome")
        assert (welcome["seat"], welcome["silence_s"]) == (1, SILENCE_S)
        await ada.roster(lambda who: set(who) == {"Ada"})
        await ada.say(type="say", text="  Anybody?  ")
        first = await ada.hear("said", text="Anybody?")
        async with await join(caller, meeting["id"], "Bo", headers=bo_header) as bo:
            members = await ada.roster(lambda who: set(who) == {"Ada", "Bo"})
            assert {name: one["role"] for name, one in members.items()} == {
                "Ada": "host",
                "Bo": "speaker",
            }
            # who comes late reads what was said
            assert await bo.hear("said", text="Anybody?") == first
            await bo.say(type="say", text="Here")
            heard = await ada.hear("said", text="Here")
            assert (heard["name"], heard["number"]) == ("Bo", first["number"] + 1)
            await bo.say(type="hand", raised=True)
            await ada.roster(lambda who: who["Bo"]["hand_at"] is not None)
            await bo.say(type="hand", raised=False)
            await ada.roster(lambda who: who["Bo"]["hand_at"] is None)
            await bo.say(type="react", reaction="applause")
            assert (await ada.hear("reacted", reaction="applause"))["name"] == "Bo"
            await bo.say(type="leave")
            assert (await bo.gone())["reason"] == "left"
            await ada.roster(lambda who: set(who) == {"Ada"})


async def test_a_cut_line_takes_its_seat_up_again_and_hears_what_it_missed(caller, timed, meeting):
    async with await join(caller, meeting["id"], "Ada") as ada:
        bo = await join(caller, meeting["id"], "Bo", headers=header(timed, "neighbours"))
        async with bo:
            before = await bo.hear("welcome")
            await ada.roster(lambda who: "Bo" in who)
            await bo.say(type="hand", raised=True)
            await ada.say(type="say", text="one")
            newest = (await bo.hear("said", text="one"))["number"]
            await ada.roster(lambda who: who["Bo"]["hand_at"] is not None)
        await ada.say(type="say", text="two")
        await ada.hear("said", text="two")
        async with Page(bo.url, bo.token, "Bo", newest) as back:
            again = await back.hear("welcome")
            assert again == before  # the same person on the same seat
            members = await back.roster(lambda who: set(who) == {"Ada", "Bo"})
            assert members["Bo"]["hand_at"] is not None
            await back.hear("said", text="two")
            assert not [m for m in back.heard if m.get("text") == "one"]


async def test_silence_means_away_and_longer_silence_gone(caller, timed, meeting, clock: Clock):
    ada = await join(caller, meeting["id"], "Ada")
    bo = await join(caller, meeting["id"], "Bo", headers=header(timed, "neighbours"))
    async with ada, bo:
        await ada.roster(lambda who: set(who) == {"Ada", "Bo"} and who["Bo"]["present"])
        await bo.hear("welcome")  # from here on, silence is counted
        for _ in range(2):
            clock.advance(seconds=SILENCE_S / 2 + 0.5)
            await ada.beat()
        assert (await bo.gone())["reason"] == "silent"
        await ada.roster(lambda who: not who["Bo"]["present"])
        async with Page(bo.url, bo.token, "Bo") as back:
            await back.hear("welcome")
            await ada.roster(lambda who: who["Bo"]["present"])
        for _ in range(round(SEAT_LAPSES_S / 4) + 1):
            clock.advance(seconds=4.0)
            await ada.beat()
        await ada.roster(lambda who: set(who) == {"Ada"})
        # somebody else may sit there now; the old token finds it taken
        async with await join(caller, meeting["id"], "Cy") as cy:
            assert (await cy.hear("welcome"))["seat"] == 2
        async with Page(bo.url, bo.token, "Bo") as late:
            assert (await late.gone())["reason"] == "given-back"


async def test_the_newest_page_on_a_seat_is_the_one(caller, meeting):
    ada = await join(caller, meeting["id"], "Ada")
    async with ada:
        first = await ada.hear("welcome")
        async with Page(ada.url, ada.token, "Ada L.") as other:
            assert await other.hear("welcome") == first
            assert (await ada.gone())["reason"] == "replaced"
            await other.roster(lambda who: set(who) == {"Ada L."})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"\x00", "must be one of the control channel's JSON objects"),
        ("no json", "must be one of the control channel's JSON objects"),
        ('{"type": "dance"}', "got a fault at the message"),
        ('{"type": "say", "text": "   "}', "got a fault at say.text"),
        (json.dumps({"type": "say", "text": "x" * 20_000}), "at most 16384 characters; got 20"),
        ('{"type": "react", "reaction": "<script>"}', "got a fault at react.reaction"),
        ('{"type": "hello", "token": "", "name": "Eve"}', "'hello' must come once"),
        ('{"type": "admit", "participant_id": "nobody"}', "somebody who is waiting; got 'nobody'"),
    ],
)
async def test_what_can_not_be_done_is_refused_in_words(caller, meeting, text, words):
    async with await join(caller, meeting["id"], "Ada") as ada:
        await ada.hear("welcome")
        await ada.send(text)
        refusal = await ada.hear("refusal")
        assert words in refusal["problem"]["detail"]
        await ada.beat()  # the line goes on


async def test_a_message_that_nobody_would_send_ends_the_channel_unread(caller, meeting):
    """It would wait in memory, with others: also of whoever has no token."""
    ada = await join(caller, meeting["id"], "Ada")
    async with Page(ada.url, 70_000 * "x", "Eve") as eve:
        await eve.until(lambda: eve.closed, "the end of the channel")
        assert eve.code == 1009
        assert eve.heard == []
    async with ada:
        await ada.hear("welcome")
        await ada.send("x" * (1 << 20))
        await ada.until(lambda: ada.closed, "the end of the channel")
        assert ada.code == 1009


async def test_only_a_seat_of_this_meeting_opens_its_channel(caller, timed, meeting):
    other = (await caller.post("/v1/meetings", json={"name": "Tuesday"})).json()
    ada = await join(caller, meeting["id"], "Ada")
    foreign = await join(caller, other["id"], "Ada")
    no_seat = header(timed, "house")["Authorization"].removeprefix("Bearer ")
    for token, words in (
        (foreign.token, "must be for meeting"),
        (no_seat, "one without a seat"),
        ("nonsense", "must be signed by this server"),
    ):
        async with Page(ada.url, token, "Eve") as eve:
            goodbye = await eve.gone()
            assert goodbye["reason"] == "refused"
            assert words in goodbye["problem"]["detail"]
    assert meeting["id"] != other["id"]


async def test_who_talks_without_end_is_told_to_wait(caller, meeting, app, timed):
    limit = RateLimit("messages of one person", 2, timed.clock)
    app.state.gateway = replace(gateway_of(app), command_limit=limit)
    async with await join(caller, meeting["id"], "Ada") as ada:
        for number in range(3):
            await ada.say(type="say", text=str(number))
        refusal = await ada.hear("refusal")
        assert "messages of one person must be at most 2 a minute" in refusal["problem"]["detail"]
        assert COMMANDS_PER_MINUTE > 2


async def test_two_gateways_are_one_meeting_by_redis(services: Services, redis_url: str):
    both = [replace(services, events=RedisEvents(redis_url)) for _ in range(2)]
    apps = [create_app(one) for one in both]
    async with on_a_port(apps[0], both[0]) as here, on_a_port(apps[1], both[1]) as there:
        opened = (await here.post("/v1/meetings", json={"name": "Monday"})).json()
        bo_header = header(services, "neighbours")
        async with (
            await join(here, opened["id"], "Ada") as ada,
            await join(there, opened["id"], "Bo", headers=bo_header) as bo,
        ):
            members = await ada.roster(lambda who: set(who) == {"Ada", "Bo"})
            await bo.roster(lambda who: set(who) == {"Ada", "Bo"})
            await ada.say(type="say", text="Hello over there")
            await bo.hear("said", text="Hello over there")
            await ada.say(type="remove", participant_id=members["Bo"]["id"])
            assert (await bo.gone())["reason"] == "removed"
    for one in both:
        one.events.close()
