"""Redis goes away under a meeting of two gateways, and comes back: nobody has to notice."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import httpx

from services.app import create_app
from services.jobs.redis_events import RedisEvents
from tests.servers import MortalRedis
from tests.services import seeds
from tests.services.conftest import bearer, changed
from tests.services.control.conftest import on_a_port
from tests.services.control.page import join
from tests.services.control.test_outage import beat, look


async def readiness(caller: httpx.AsyncClient) -> tuple[int, str]:
    answer = await caller.get("/readyz")
    return answer.status_code, answer.json()["status"]


async def test_a_meeting_of_two_gateways_outlives_redis(
    services, model_file, mortal_redis: MortalRedis
):
    model = seeds.imported(services, model_file, "house", "Robin")
    settings = changed(services.settings, redis_url=mortal_redis.url)
    both = [
        replace(services, settings=settings, events=RedisEvents(mortal_redis.url)) for _ in "ab"
    ]
    apps = [create_app(one) for one in both]
    async with on_a_port(apps[0], both[0]) as here, on_a_port(apps[1], both[1]) as there:
        body = {"name": "Monday", "model_ids": [model.id]}
        meeting_id = (await here.post("/v1/meetings", json=body)).json()["id"]
        guest = bearer(services, "guest-bo")
        async with (
            await join(here, meeting_id, "Ada") as ada,
            await join(there, meeting_id, "Bo", headers=guest) as bo,
        ):
            beating = [asyncio.create_task(beat(page)) for page in (ada, bo)]
            await ada.roster(lambda who: set(who) == {"Ada", "Bo"})
            viewer = await look(there, meeting_id, bo)
            assert await readiness(there) == (200, "ready")

            mortal_redis.kill()
            assert await readiness(here) == await readiness(there) == (200, "degraded")
            await ada.say(type="say", text="Is anything wrong?")
            await bo.hear("said", text="Is anything wrong?")
            await bo.say(type="hand", raised=True)
            await ada.roster(lambda who: who["Bo"]["hand_at"] is not None)
            assert (await viewer.frame()).std() > 5
            async with await join(here, meeting_id, "Cy", headers=guest) as cy:
                await cy.hear("said", text="Is anything wrong?")

            mortal_redis.start()
            assert await readiness(here) == await readiness(there) == (200, "ready")
            await bo.say(type="say", text="Not at all")
            await ada.hear("said", text="Not at all")
            assert (await viewer.frame()).std() > 5
            assert (ada.closed, bo.closed) == (False, False)
            for one in beating:
                one.cancel()
            await viewer.peer.close()
    for one in both:
        one.events.close()
