"""Who is let in, who may do what, and that nobody else sees anything."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from services.auth import Tokens
from services.bootstrap import ensure_demo
from services.container import Services
from services.gateway import gateway_of
from tests.services import seeds
from tests.services.control.page import Page, join
from tests.services.control.test_channel import header
from tests.services.live.viewer import Viewer


@pytest.fixture
async def crowd(caller: httpx.AsyncClient, timed: Services, model_file: Path) -> dict:
    """A meeting of account `house` with somebody standing in it."""
    model = seeds.imported(timed, model_file, "house", "Robin")
    body = {"name": "Monday", "model_ids": [model.id], "lobby": True}
    return (await caller.post("/v1/meetings", json=body)).json()


async def looks(caller: httpx.AsyncClient, meeting_id: str, page: Page) -> httpx.Response:
    """What comes of asking for a live picture from the seat of `page`."""
    viewer = Viewer()
    try:
        return await viewer.look(caller, meeting_id, {"Authorization": f"Bearer {page.token}"})
    finally:
        await viewer.peer.close()


async def test_the_lobby_shows_nothing_until_the_host_lets_in(caller, timed, crowd):
    async with (
        await join(caller, crowd["id"], "Ada") as ada,
        await join(caller, crowd["id"], "Bo", headers=header(timed, "neighbours")) as bo,
        await join(caller, crowd["id"], "Cy", headers=header(timed, "neighbours")) as cy,
    ):
        members = await ada.roster(lambda who: set(who) == {"Ada", "Bo", "Cy"})
        assert members["Bo"]["admission"] == "waiting"
        await ada.say(type="say", text="A secret")
        await ada.hear("said", text="A secret")
        for one in (bo, cy):
            await one.roster(lambda who, name=one.name: set(who) == {name})
            refused = await looks(caller, crowd["id"], one)
            assert refused.status_code == 403
            assert "wait until you are let in" in refused.json()["detail"]
        await bo.say(type="say", text="Me too")
        assert "wait for the host" in (await bo.hear("refusal"))["problem"]["detail"]
        await ada.say(type="admit", participant_id=members["Bo"]["id"])
        await ada.say(type="deny", participant_id=members["Cy"]["id"])
        await bo.roster(lambda who: set(who) == {"Ada", "Bo"})
        await bo.hear("said", text="A secret")
        assert (await cy.gone())["reason"] == "denied"
        assert (await looks(caller, crowd["id"], bo)).status_code == 201
        assert (await looks(caller, crowd["id"], cy)).status_code == 403
        assert not [m for m in cy.heard if m["type"] == "said"]
        async with Page(cy.url, cy.token, "Cy") as again:
            assert (await again.gone())["reason"] == "denied"
        # an invitation alone shows nothing either
        foreign = Viewer()
        refused = await foreign.look(caller, crowd["id"], header(timed, "neighbours"))
        assert refused.status_code == 403
        await foreign.peer.close()
        await ada.say(type="lobby", on=False)
        async with await join(caller, crowd["id"], "Di", headers=header(timed, "x")) as di:
            await di.roster(lambda who: set(who) == {"Ada", "Bo", "Di"})


async def test_who_is_sent_out_sees_nothing_more_at_once(caller, timed, crowd, app):
    async with await join(caller, crowd["id"], "Ada") as ada:
        await ada.say(type="lobby", on=False)
        await ada.hear_that("roster", lambda roster: not roster["lobby"])
        async with await join(caller, crowd["id"], "Bo", headers=header(timed, "x")) as bo:
            bo_id = (await bo.hear("welcome"))["participant_id"]
            viewer = Viewer()
            mine = {"Authorization": f"Bearer {bo.token}"}
            assert (await viewer.look(caller, crowd["id"], mine)).status_code == 201
            await viewer.opened()
            assert (await viewer.frame()).size > 0
            assert len(gateway_of(app).views) == 1
            await ada.say(type="remove", participant_id=bo_id)
            assert (await bo.gone())["reason"] == "removed"
            await ada.roster(lambda who: set(who) == {"Ada"})
            while gateway_of(app).views.is_watched(crowd["id"]):
                await ada.beat()
            await viewer.peer.close()
            refused = await looks(caller, crowd["id"], bo)
            assert (refused.status_code, refused.json()["title"]) == (403, "Removed")
            # the link brings whoever they might be next to the lobby, and themselves nowhere
            await ada.hear_that("roster", lambda roster: roster["lobby"])
            address = f"/v1/meetings/{crowd['id']}/join"
            assert (await caller.post(address, json={}, headers=mine)).status_code == 403
            other = await join(caller, crowd["id"], "Cy", headers=header(timed, "y"))
            async with other:
                await other.roster(lambda who: who["Cy"]["admission"] == "waiting")


async def test_the_host_hands_over_and_others_have_no_say(caller, timed, meeting):
    async with (
        await join(caller, meeting["id"], "Ada") as ada,
        await join(caller, meeting["id"], "Bo", headers=header(timed, "neighbours")) as bo,
    ):
        members = await ada.roster(lambda who: set(who) == {"Ada", "Bo"})
        ada_id, bo_id = members["Ada"]["id"], members["Bo"]["id"]
        await bo.say(type="remove", participant_id=ada_id)
        assert (
            "from the host; got it from a speaker"
            in (await bo.hear("refusal"))["problem"]["detail"]
        )
        await ada.say(type="remove", participant_id=ada_id)
        assert "make another the host first" in (await ada.hear("refusal"))["problem"]["detail"]
        await ada.say(type="role", participant_id=bo_id, role="viewer")
        await bo.roster(lambda who: who["Bo"]["role"] == "viewer")
        bo.heard.clear()
        await bo.say(type="say", text="Hello")
        assert "raise a hand" in (await bo.hear("refusal"))["problem"]["detail"]
        await bo.say(type="hand", raised=True)
        await ada.roster(lambda who: who["Bo"]["hand_at"] is not None)
        await ada.say(type="role", participant_id=bo_id, role="host")
        members = await bo.roster(lambda who: who.get("Bo", {}).get("role") == "host")
        assert members["Ada"]["role"] == "speaker"
        await bo.say(type="lobby", on=True)
        await bo.hear_that("roster", lambda roster: roster["lobby"])
        await bo.say(type="remove", participant_id=ada_id)
        assert (await ada.gone())["reason"] == "removed"
        # the seat she had as host gives her no second one that passes the lobby
        again = await join(
            caller, meeting["id"], "Ada", headers={"Authorization": f"Bearer {ada.token}"}
        )
        async with again:
            await again.roster(lambda who: who["Ada"]["admission"] == "waiting")


async def test_a_host_comes_back_as_host_unless_another_is_there(caller, timed, meeting):
    ada = await join(caller, meeting["id"], "Ada")
    async with ada:
        await ada.roster(lambda who: who["Ada"]["role"] == "host")
    async with Page(ada.url, ada.token, "Ada") as back:
        await back.roster(lambda who: who["Ada"]["role"] == "host")
        second = await join(caller, meeting["id"], "Ada on the phone")
        async with second:
            members = await second.roster(lambda who: len(who) == 2)
            assert members["Ada on the phone"]["role"] == "speaker"
        await back.say(type="leave")
        await back.gone()
    host = {"Authorization": f"Bearer {meeting['host_token']}"}
    async with await join(caller, meeting["id"], "Ada", headers=host) as new:
        await new.roster(lambda who: who["Ada"]["role"] == "host")
    assert (
        Tokens(timed.settings.signing_keys(), timed.clock).read(meeting["host_token"]).role
        == "host"
    )


async def test_the_end_is_for_everybody_and_for_good(caller, timed, meeting):
    async with (
        await join(caller, meeting["id"], "Ada") as ada,
        await join(caller, meeting["id"], "Bo", headers=header(timed, "neighbours")) as bo,
    ):
        await ada.roster(lambda who: set(who) == {"Ada", "Bo"})
        await ada.say(type="end")
        assert (await ada.gone())["reason"] == "ended"
        assert (await bo.gone())["reason"] == "ended"
    late = await caller.post(f"/v1/meetings/{meeting['id']}/join", json={})
    assert late.status_code == 410
    assert "must not be over" in late.json()["detail"]
    assert (await looks(caller, meeting["id"], bo)).status_code == 410


async def test_the_demo_is_hosted_by_who_comes_first_and_never_ends(caller, timed, model_file):
    meeting_id = ensure_demo(timed, model_file, "Robin")
    guest = header(timed, "guest")
    async with (
        await join(caller, meeting_id, "Ada", headers=guest) as ada,
    ):
        await ada.roster(lambda who: who["Ada"]["role"] == "host")
        async with await join(caller, meeting_id, "Bo", headers=guest) as bo:
            members = await bo.roster(lambda who: len(who) == 2)
            assert members["Bo"]["role"] == "speaker"
            await ada.say(type="lobby", on=True)
            await ada.hear_that("roster", lambda roster: roster["lobby"])
            di = await join(caller, meeting_id, "Di", headers=guest)
            async with di:
                await di.roster(lambda who: who["Di"]["admission"] == "waiting")
            await ada.say(type="end")
            assert (await bo.gone())["reason"] == "ended"
    async with await join(caller, meeting_id, "Cy", headers=guest) as cy:
        await cy.roster(lambda who: who["Cy"]["role"] == "host")
        ed = await join(caller, meeting_id, "Ed", headers=guest)
        async with ed:
            await ed.roster(lambda who: who["Ed"]["admission"] == "waiting")
            await cy.say(type="leave")
            await cy.gone()
        # nobody is left to let him in: who may host needs no one
        async with Page(ed.url, ed.token, "Ed") as back:
            await back.roster(lambda who: who["Ed"]["role"] == "host")
    # a meeting that a guest opened is not every guest's to host
    opened = (await caller.post("/v1/meetings", json={"name": "x"}, headers=guest)).json()
    async with await join(caller, opened["id"], "Bo", headers=guest) as bo:
        await bo.roster(lambda who: who["Bo"]["role"] == "speaker")
