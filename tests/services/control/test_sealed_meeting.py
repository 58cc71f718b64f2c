"""A sealed meeting on the control channel: it is not recorded, and says why."""

from __future__ import annotations

from tests.services.control.page import join


async def test_nobody_records_a_sealed_meeting(caller):
    body = {"name": "Monday", "sealed": True}
    meeting = (await caller.post("/v1/meetings", json=body)).json()
    async with await join(caller, meeting["id"], "Ada") as ada:
        await ada.roster(lambda who: set(who) == {"Ada"})
        await ada.say(type="record", on=True)
        problem = (await ada.hear("refusal"))["problem"]
        assert (problem["status"], problem["type"]) == (409, "urn:metanerf:meeting-sealed")
        assert "must not be sealed" in problem["detail"]
        # asking to end what never began is no reason to refuse, and chat goes on
        await ada.say(type="record", on=False)
        await ada.say(type="say", text="Hello")
        await ada.hear("said", text="Hello")
    listed = (await caller.get("/v1/recordings")).json()
    assert listed["items"] == []
