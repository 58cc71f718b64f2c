"""Whom somebody invited has brought goes with them, and a look at the start page brings nobody."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx

from services.container import Services
from services.seats import SEAT_LAPSES_S
from tests.fakes import Clock
from tests.services import seeds
from tests.services.conftest import bearer
from tests.services.control.page import join


async def bring(caller: httpx.AsyncClient, path: str, model_id: str, headers: dict) -> str:
    answer = await caller.post(f"{path}/performers", json={"model_id": model_id}, headers=headers)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


async def test_who_leaves_takes_along_whom_they_brought(
    caller: httpx.AsyncClient, timed: Services, meeting: dict[str, Any], model_file: Path
):
    model = seeds.imported(timed, model_file, "neighbours", "Bo")
    mine, path = bearer(timed, "neighbours"), f"/v1/meetings/{meeting['id']}"
    async with await join(caller, meeting["id"], "Ada") as ada:
        async with await join(caller, meeting["id"], "Bo", headers=mine) as bo:
            await bo.hear("welcome")
            brought = await bring(caller, path, model.id, mine)
            assert brought in (await ada.hear("roster", performer_ids=[brought]))["performer_ids"]
            await bo.say(type="leave")
        assert (await ada.hear("roster", performer_ids=[]))["performer_ids"] == []
        # the first page's preview has a seat, too
        await caller.post(f"{path}/join", json={"display_name": "Bo"}, headers=mine)
        assert (await caller.get(path, headers=mine)).json()["performers"] == []


async def test_whose_page_is_lost_is_shown_until_their_seat_lapses(
    caller: httpx.AsyncClient,
    timed: Services,
    meeting: dict[str, Any],
    model_file: Path,
    clock: Clock,
):
    model = seeds.imported(timed, model_file, "neighbours", "Bo")
    mine, path = bearer(timed, "neighbours"), f"/v1/meetings/{meeting['id']}"

    async def shown() -> int:
        return len((await caller.get(path, headers=mine)).json()["performers"])

    async with await join(caller, meeting["id"], "Bo", headers=mine) as bo:
        await bo.hear("welcome")
        await bring(caller, path, model.id, mine)
    clock.advance(seconds=SEAT_LAPSES_S - 1.0)
    assert await shown() == 1
    clock.advance(seconds=2.0)
    assert await shown() == 0
