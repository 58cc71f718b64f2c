"""Following a job: its news come as events, to so many at once."""

from __future__ import annotations

from dataclasses import replace

import httpx

from services.app import create_app
from services.container import Services
from services.gateway import gateway_of
from services.limits import AtOnce
from tests.services.api.authorisation_world import Caller, World


async def test_an_account_follows_so_many_jobs_at_once(world_services: Services, world: World):
    app = create_app(world_services)
    followers = AtOnce("jobs that one account follows", 1)
    app.state.gateway = replace(gateway_of(app), followers=followers)
    path = world.ada.path("/v1/jobs/{job_id}/events")
    async with httpx.AsyncClient(
        transport=httpx.ASGITransport(app),
        base_url="http://test",
        headers=world.headers(Caller.GUEST),
    ) as caller:
        ada = world_services.tokens.read(world.tokens[Caller.GUEST]).account
        with followers.held(ada):
            full = await caller.get(path)
            assert (full.status_code, full.headers["retry-after"]) == (429, "10")
        # one that has ended counts no more
        for _ in range(2):
            told = await caller.get(path)
            assert told.status_code == 200
            assert "event: end" in told.text
    await gateway_of(app).close()
