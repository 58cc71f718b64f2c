"""Viewers over real WebRTC whose pictures come from renderers that are children of the gateway."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import httpx
import numpy as np
import pytest
from fastapi import FastAPI

from services.container import Services
from services.gateway import gateway_of
from tests.services import seeds
from tests.services.jobs.homes import parent_of
from tests.services.jobs.waiting import until
from tests.services.live.rendering.watching import is_gone
from tests.services.live.viewer import Viewer, view

pytestmark = pytest.mark.parametrize(
    "changes", [{"renderers": "processes", "renderer_viewers": 1, "renderer_idle_s": 60.0}]
)


def renderers_of(process_id: int) -> list[int]:
    """Ids of the renderers that a process has started."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (folder / "cmdline").read_bytes().split(b"\0")
            if b"services.live.rendering.child" in words:
                found.append(int(folder.name))
    return [one for one in found if parent_of(one) == process_id]


@pytest.fixture
async def meeting(
    caller: httpx.AsyncClient, services: Services, model_file: Path
) -> tuple[str, dict[str, str]]:
    """Its id, and the header of one who has joined."""
    model = seeds.imported(services, model_file, "house", "Ada")
    body = {"name": "Monday", "model_ids": [model.id]}
    opened = (await caller.post("/v1/meetings", json=body)).json()
    joined = await caller.post(f"/v1/meetings/{opened['id']}/join", json={"display_name": "Bo"})
    return opened["id"], {"Authorization": f"Bearer {joined.json()['token']}"}


@asynccontextmanager
async def looking(viewer: Viewer, packets: list[bytes]) -> AsyncIterator[None]:
    """The newest of `packets` goes up again and again, as from a page: who falls silent is gone."""

    async def send() -> None:
        while True:
            viewer.channel.send(packets[-1])
            await asyncio.sleep(0.5)

    sending = asyncio.create_task(send())
    yield
    sending.cancel()


async def warm(app: FastAPI) -> None:
    """Until a renderer has started; on a busy machine a process takes long for that."""
    for _ in range(1200):
        if gateway_of(app).views.ready:
            return
        await asyncio.sleep(0.1)
    raise AssertionError("no renderer started within two minutes")


async def moves(viewer: Viewer) -> bool:
    """Whether pictures that come differ."""
    before = await viewer.frame()
    for _ in range(90):
        picture = await viewer.frame()
        if picture.shape != before.shape or np.abs(picture.astype(int) - before).mean() > 0.1:
            return True
    return False


async def test_a_viewer_whose_renderers_are_killed_sees_people_move_again(app, caller, meeting):
    viewer, other, sent = Viewer(), Viewer(), [view(1, 0.0, 3.0)]
    assert (await viewer.look(caller, *meeting)).status_code == 201
    await viewer.opened()
    async with looking(viewer, sent):
        await warm(app)
        assert (await viewer.frame_of_size(160)).std() > 5
        assert await moves(viewer)

        refused = await other.look(caller, *meeting)
        assert refused.status_code == 503
        assert int(refused.headers["retry-after"]) > 0
        assert "each for 1 viewers" in refused.json()["detail"]

        killed = renderers_of(os.getpid())
        assert killed
        for process_id in killed:
            os.kill(process_id, signal.SIGKILL)
        until(lambda: all(map(is_gone, killed)), "their end")
        sent.append(view(2, 1.0, 3.0, 192))
        await asyncio.sleep(1.0)  # the loss is noticed
        await warm(app)
        # what was on its way still comes
        assert (await viewer.frame_of_size(192)).std() > 5
        assert await moves(viewer)
    for one in (viewer, other):
        await one.peer.close()


async def test_nothing_is_left_of_renderers_whose_gateway_ends(app, caller, meeting):
    viewer = Viewer()
    await viewer.look(caller, *meeting)
    await viewer.opened()
    async with looking(viewer, [view(1, 0.0, 3.0)]):
        await warm(app)
        await viewer.frame()
    left = renderers_of(os.getpid())
    assert left
    await gateway_of(app).close()
    assert all(map(is_gone, left))
    await viewer.peer.close()
