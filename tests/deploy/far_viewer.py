"""Somebody on another machine, who reaches the deployed one by one address: run as a program.

    python -m tests.deploy.far_viewer ADDRESS TOKEN MODEL_ID

Names below `localhost` are that address. Tells, as JSON, which of the relay's addresses they were
given and what each of them brought alone: how much its picture varies, 0 to 127.
"""

from __future__ import annotations

import asyncio
import json
import socket
import sys
from itertools import count

import httpx
from aiortc import RTCConfiguration, RTCIceServer

from tests.services.live.viewer import Viewer, view

_PATIENCE_S = 90.0


def find_names_at(address: str) -> None:
    """Have this process find the deployed machine."""
    ask = socket.getaddrinfo

    def getaddrinfo(host, *about, **more):
        name = host.decode() if isinstance(host, bytes) else host
        ours = name is not None and name.split(".")[-1] == "localhost"
        return ask(address if ours else host, *about, **more)

    socket.getaddrinfo = getaddrinfo


async def look(token: str, model_id: str) -> dict[str, float]:
    """The picture by each address of the relay."""
    header = {"Authorization": f"Bearer {token}"}
    seen = {}
    async with httpx.AsyncClient(
        base_url="https://localhost", headers=header, follow_redirects=True, timeout=30.0
    ) as caller:
        async with asyncio.timeout(_PATIENCE_S):
            while not await answers(caller):
                await asyncio.sleep(0.2)
        about = {"name": "Monday", "model_ids": [model_id]}
        meeting = (await caller.post("/v1/meetings", json=about)).json()
        path = f"/v1/meetings/{meeting['id']}/join"
        [relay] = (await caller.post(path, json={})).json()["ice_servers"]
        for url in relay["urls"]:
            seat = (await caller.post(path, json={})).json()
            seen[url] = await picture(caller, meeting["id"], seat, url)
    return seen


async def answers(caller: httpx.AsyncClient) -> bool:
    """Whether there is a gateway yet."""
    try:
        return (await caller.get("/healthz")).is_success
    except httpx.TransportError:
        return False


async def picture(caller: httpx.AsyncClient, meeting_id: str, seat: dict, url: str) -> float:
    """What comes by this address of the relay, where nothing else leads to the gateway."""
    [relay] = seat["ice_servers"]
    server = RTCIceServer(url, relay["username"], relay["credential"])
    viewer = Viewer(RTCConfiguration(iceServers=[server]))
    header = {"Authorization": f"Bearer {seat['token']}"}
    answer = await viewer.look(caller, meeting_id, header)
    assert answer.status_code == 201, answer.text
    await viewer.opened()
    looking = asyncio.create_task(keep_looking(viewer))
    frame = await viewer.frame()
    looking.cancel()
    await viewer.peer.close()
    return float(frame.std())


async def keep_looking(viewer: Viewer) -> None:
    """Say where from now and then: whoever is silent has left."""
    for sequence in count(1):
        viewer.channel.send(view(sequence, 0.0, 3.0))
        await asyncio.sleep(1.0)


if __name__ == "__main__":
    find_names_at(sys.argv[1])
    print(json.dumps(asyncio.run(look(*sys.argv[2:]))))
