"""Viewers over real WebRTC whose pictures come from renderers that are children of the gateway."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path

import httpx
import numpy as np
import pytest

from services.bootstrap import import_model
from services.container import Services
from services.gateway import gateway_of
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
    model = import_model(services, model_file, "house", "Ada")
    body = {"name": "Monday", "model_ids": [model.id]}
    opened = (await caller.post("/v1/meetings", json=body)).json()
    joined = await caller.post(f"/v1/meetings/{opened['id']}/join", json={"display_name": "Bo"})
    return opened["id"], {"Authorization": f"Bearer {joined.json()['token']}"}


async def moves(viewer: Viewer) -> bool:
    """Whether pictures that come differ."""
    before = await viewer.frame()
    for _ in range(90):
        picture = await viewer.frame()
        if picture.shape != before.shape or np.abs(picture.astype(int) - before).mean() > 0.1:
            return True
    return False


async def test_a_viewer_whose_renderers_are_killed_sees_people_move_again(app, caller, meeting):
    viewer = Viewer()
    assert (await viewer.look(caller, *meeting)).status_code == 201
    await viewer.opened()
    viewer.channel.send(view(1, 0.0, 3.0))
    assert (await viewer.frame_of_size(160)).std() > 5
    assert await moves(viewer)

    other = Viewer()
    refused = await other.look(caller, *meeting)
    assert refused.status_code == 503
    assert int(refused.headers["retry-after"]) > 0
    assert "each for 1 viewers" in refused.json()["detail"]

    killed = renderers_of(os.getpid())
    assert killed
    for process_id in killed:
        os.kill(process_id, signal.SIGKILL)
    until(lambda: all(map(is_gone, killed)), "their end")
    # what was on its way still comes
    for _ in range(30):
        viewer.channel.send(view(2, 1.0, 3.0, 192))
        if (await viewer.frame()).shape[0] == 192:
            break
    assert await moves(viewer)
    for one in (viewer, other):
        await one.peer.close()


async def test_nothing_is_left_of_renderers_whose_gateway_ends(app, caller, meeting):
    viewer = Viewer()
    await viewer.look(caller, *meeting)
    await viewer.frame()
    left = renderers_of(os.getpid())
    assert left
    await gateway_of(app).close()
    assert all(map(is_gone, left))
    await viewer.peer.close()
