"""A meeting's place, chosen while people look: their pictures move there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.services import seeds
from tests.services.live.test_whep import open_meeting
from tests.services.live.viewer import Viewer


async def test_everybody_who_looks_sees_the_new_place(app, caller, services, model_file):
    model = seeds.imported(services, model_file, "house", "Ada")
    meeting_id, header = await open_meeting(caller, model)
    viewers = [Viewer(), Viewer()]
    for viewer in viewers:
        assert (await viewer.look(caller, meeting_id, header)).status_code == 201
    for viewer in viewers:
        assert await _turns_to(viewer, lambda sky: sky[2] > sky[1])  # the studio's is blue
    path = f"/v1/meetings/{meeting_id}/environment"
    assert (await caller.put(path, json={"name": "lobby"})).status_code == 200
    for viewer in viewers:
        assert await _turns_to(viewer, lambda sky: sky[0] > 1.2 * sky[2])  # the lobby is warm
        await viewer.peer.close()


async def _turns_to(viewer: Viewer, wanted: Callable[[np.ndarray], bool]) -> bool:
    """Whether the upper edge of one of the next pictures is as `wanted`."""
    for _ in range(90):
        if wanted((await viewer.frame())[:90].mean(axis=(0, 1))):
            return True
    return False
