"""A real outage of ten seconds: sockets gone without a word, then back on the same seat."""

from __future__ import annotations

import asyncio

from benchmarks.load.person import drop_sockets
from services.app import create_app
from services.control.roster import SILENCE_S
from tests.services import seeds
from tests.services.conftest import bearer
from tests.services.control.conftest import on_a_port
from tests.services.control.page import Page, join
from tests.services.control.test_voices import Headset, seat_of
from tests.services.live.viewer import Viewer, view

OUTAGE_S = 10.0
"""What docs/meeting.md promises. It passes by the real clock: ICE's consent and SCTP's retries on
the dead sockets, which must not end the server's tasks meanwhile, know no other."""
BACK_S = 3.0
"""What coming back may take: the picture, the voice and the seat."""


async def look(caller, meeting_id: str, page: Page) -> Viewer:
    """A viewer who sees pictures."""
    viewer = Viewer()
    answer = await viewer.look(caller, meeting_id, seat_of(page))
    assert answer.status_code == 201
    await viewer.opened()
    viewer.channel.send(view(1, 0.0, 3.0))
    assert (await viewer.frame()).std() > 5
    return viewer


async def test_ten_seconds_without_a_network_cost_nobody_their_seat(services, model_file):
    model = seeds.imported(services, model_file, "house", "Robin")
    app = create_app(services)
    async with on_a_port(app, services) as caller:
        body = {"name": "Monday", "model_ids": [model.id]}
        meeting_id = (await caller.post("/v1/meetings", json=body)).json()["id"]
        async with await join(caller, meeting_id, "Ada") as ada:
            listening = Headset(tone=False)
            await listening.call(caller, meeting_id, seat_of(ada))
            beating = asyncio.create_task(beat(ada))
            bo = await join(caller, meeting_id, "Bo", headers=bearer(services, "guest-bo"))
            async with bo:
                seat = await bo.hear("welcome")
                talking, viewer = Headset(), await look(caller, meeting_id, bo)
                await talking.call(caller, meeting_id, seat_of(bo))
                await bo.say(type="microphone", on=True)
                await listening.until(True)
                await bo.say(type="hand", raised=True)
                await ada.roster(lambda who: who["Bo"]["hand_at"] is not None)
                drop_sockets(talking.peer)
                drop_sockets(viewer.peer)
            # the line went too: after some seconds of silence the others are told
            gone = asyncio.create_task(ada.roster(lambda who: not who["Bo"]["present"]))
            await asyncio.sleep(OUTAGE_S)
            assert gone.done()
            assert OUTAGE_S > SILENCE_S
            async with asyncio.timeout(BACK_S), Page(bo.url, bo.token, "Bo", 0) as back:
                again = await back.hear("welcome")
                assert again == seat
                members = await back.roster(lambda who: who["Bo"]["present"])
                assert members["Bo"]["hand_at"] is not None
                talking_again = Headset()
                await talking_again.call(caller, meeting_id, seat_of(bo))
                await back.say(type="microphone", on=True)
                await listening.until(True)
                viewer_again = await look(caller, meeting_id, bo)
                # a reload takes the seat up from the page before
                async with Page(bo.url, bo.token, "Bo", 0) as reloaded:
                    assert await reloaded.hear("welcome") == seat
                    assert (await back.gone())["reason"] == "replaced"
            beating.cancel()
            for peer in (listening.peer, talking_again.peer, viewer_again.peer):
                await peer.close()
            for dead in (talking.peer, viewer.peer):
                await dead.close()


async def beat(page: Page) -> None:
    """Signs of life, as a page gives them."""
    while True:
        await page.say(type="beat")
        await asyncio.sleep(1.0)
