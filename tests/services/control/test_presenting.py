"""Where a meeting is held, who shares a screen, captions, how well each is connected."""

from __future__ import annotations

from contextlib import asynccontextmanager

import pytest

from services.gateway import gateway_of
from tests.services.control.page import Page, join
from tests.services.control.test_channel import header


@pytest.fixture
async def three(caller, timed, meeting):
    """Ada, the host, and two who came from elsewhere."""
    elsewhere = header(timed, "neighbours")

    @asynccontextmanager
    async def seated():
        async with (
            await join(caller, meeting["id"], "Ada") as ada,
            await join(caller, meeting["id"], "Bo", headers=elsewhere) as bo,
            await join(caller, meeting["id"], "Cy", headers=elsewhere) as cy,
        ):
            who = await ada.roster(lambda who: set(who) == {"Ada", "Bo", "Cy"})
            yield ada, bo, cy, {name: one["id"] for name, one in who.items()}

    return seated


async def presented(page: Page, presenter: str | None, asks: str | None = None) -> None:
    """Wait until the newest roster names these."""

    def fits() -> bool:
        rosters = [m for m in page.heard if m["type"] == "roster"]
        told = [(m["presenter_id"], m["presenter_asks_id"]) for m in rosters]
        return told[-1:] == [(presenter, asks)]  # maybe none was heard yet

    await page.until(fits, f"{presenter} presenting, {asks} asking")


async def test_every_page_is_told_of_a_new_place_and_who_comes_later_too(caller, meeting, three):
    async with three() as (ada, bo, cy, _):
        for page in (ada, bo, cy):
            await page.hear("roster", environment="studio")
        path = f"/v1/meetings/{meeting['id']}/environment"
        assert (await caller.put(path, json={"name": "park"})).status_code == 200
        for page in (ada, bo, cy):
            await page.hear("roster", environment="park")
        async with await join(caller, meeting["id"], "Dee") as dee:
            await dee.hear("roster", environment="park")


async def test_one_screen_at_a_time_and_the_host_decides_who_takes_over(three, app, meeting):
    async with three() as (ada, bo, cy, ids):
        voices = gateway_of(app).voices
        await bo.say(type="present", on=True)
        await presented(cy, ids["Bo"])
        await cy.say(type="present", on=True)
        await presented(ada, ids["Bo"], ids["Cy"])
        await presented(cy, ids["Bo"], ids["Cy"])
        assert bo.heard[-1].get("presenter_asks_id") is None
        await ada.say(type="let-present", participant_id=ids["Cy"], on=True)
        await presented(bo, ids["Cy"])
        await ada.beat()
        assert voices.may_present(meeting["id"], ids["Cy"])
        assert not voices.may_present(meeting["id"], ids["Bo"])
        await bo.say(type="present", on=True)
        await presented(ada, ids["Cy"], ids["Bo"])
        await ada.say(type="let-present", participant_id=ids["Bo"], on=False)
        await presented(ada, ids["Cy"])
        # the host takes over without asking, and stops others
        await ada.say(type="present", on=True)
        await presented(cy, ids["Ada"])
        await ada.say(type="present", on=False)
        await presented(cy, None)
        await cy.say(type="present", on=True)
        await presented(ada, ids["Cy"])
        await ada.say(type="let-present", participant_id=ids["Cy"], on=False)
        await presented(cy, None)


async def test_who_leaves_or_only_looks_on_presents_no_longer(three):
    async with three() as (ada, bo, cy, ids):
        await bo.say(type="present", on=True)
        await presented(ada, ids["Bo"])
        await ada.say(type="role", participant_id=ids["Bo"], role="viewer")
        await presented(cy, None)
        await bo.say(type="present", on=True)
        assert "raise a hand" in (await bo.hear("refusal"))["problem"]["detail"]
        await cy.say(type="let-present", participant_id=ids["Cy"], on=True)
        assert "from the host" in (await cy.hear("refusal"))["problem"]["detail"]
        await cy.say(type="present", on=True)
        await presented(ada, ids["Cy"])
        await cy.say(type="leave")
        await presented(ada, None)


async def test_captions_reach_all_and_are_not_kept(caller, timed, clock, meeting, three):
    async with three() as (ada, bo, cy, ids):
        await bo.say(type="caption", text="  I was saying  ")
        for page in (ada, cy):
            await page.hear("captioned", text="I was saying", participant_id=ids["Bo"], name="Bo")
        await ada.say(type="role", participant_id=ids["Bo"], role="viewer")
        await bo.hear_that("roster", lambda m: any(one["role"] == "viewer" for one in m["members"]))
        await bo.say(type="caption", text="And more")
        assert "raise a hand" in (await bo.hear("refusal"))["problem"]["detail"]
    clock.advance(seconds=61.0)
    async with await join(caller, meeting["id"], "Dee") as dee:
        await dee.say(type="caption", text="Later")
        await dee.hear("captioned", text="Later")
        assert not [m for m in dee.heard if m.get("text") == "I was saying"]
    with timed.reading() as unit:
        assert [one.text for one in unit.meetings.messages_after(meeting["id"], 0)] == ["Later"]


async def test_the_roster_says_how_well_each_is_connected(three):
    async with three() as (ada, bo, _, _ids):
        await bo.say(type="network", connection="poor")
        await ada.roster(lambda who: who["Bo"]["connection"] == "poor")
        await bo.say(type="network", connection="splendid")
        assert "connection" in (await bo.hear("refusal"))["problem"]["detail"]
        assert (await ada.roster(lambda who: True))["Ada"]["connection"] is None
